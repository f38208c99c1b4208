"""The simulated robot against statics, the limit surface and itself."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_simulation.sim.plant import Plant
from crux_tools.robot3d.robot_model import build_model
from crux_tools.robot3d.start_pose import StartPoseError
from crux_tools.telemetry.rotations import rotation_from_rpy
from hand_plan import BODY_HEIGHT_M, MASS_KG, NOMINAL_M, PAD_HEIGHT_M, Wall, standing_plan
from holding_controller import HoldingController

SCALER = load_robot("scaler")
SEED = 3


def make_plant(wall: Wall | None = None, seed: int = SEED) -> Plant:
    plan = standing_plan(wall)
    return Plant(build_model(SCALER, plan), plan, seed)


@pytest.fixture(scope="module")
def standing() -> tuple[Plant, np.ndarray, np.ndarray]:
    """A plant that has stood for 2 s, its pad positions then, and 10 s later."""
    plant = make_plant()
    HoldingController(plant).run(2.0)
    before = plant.data.geom_xpos[plant.robot.pad_geoms].copy()
    HoldingController(plant).run(10.0)
    return plant, before, plant.data.geom_xpos[plant.robot.pad_geoms].copy()


def test_model_carries_the_mass_and_the_pose_of_the_description() -> None:
    plant = make_plant(Wall(yaw_rad=np.array([0.3, -0.2, 0.1, 0.0])))
    assert plant.model.body_subtreemass[plant.robot.body] == pytest.approx(MASS_KG)
    for limb, yaw in enumerate([0.3, -0.2, 0.1, 0.0]):
        site = plant.robot.gripper_sites[limb]
        np.testing.assert_allclose(plant.data.site_xpos[site], [*NOMINAL_M[limb], PAD_HEIGHT_M], atol=1e-5)
        np.testing.assert_allclose(plant.data.site_xmat[site].reshape(3, 3), rotation_from_rpy([0, 0, yaw]), atol=1e-5)
    low, high = plant.model.jnt_range[plant.model.dof_jntid[plant.robot.joint_dof]].T
    assert np.all((plant.joint_position_rad > low) & (plant.joint_position_rad < high))


def test_stands_for_ten_seconds_without_creep(standing: tuple[Plant, np.ndarray, np.ndarray]) -> None:
    plant, before, after = standing
    assert np.linalg.norm(after - before, axis=1).max() < 1e-3
    assert np.linalg.norm(plant.data.qpos[:3] - [0, 0, BODY_HEIGHT_M]) < 0.01
    assert plant.limbs_on_holds().all()
    assert plant.link_contact_force_n == 0.0


def test_a_grip_does_not_turn_away_under_a_moment_that_is_far_from_its_limit() -> None:
    """Right front bears it at a fifth of what (2) allows, and yields to it as under force control. In a stance of 100 s
    a pad may creep by a millimetre: a fifth of what counts as a slip.
    """
    plant, limb = make_plant(Wall(slope_deg=90.0)), 1
    robot, controller = plant.robot, HoldingController(plant, 60.0)
    joints = slice(6 * limb, 6 * limb + 6)
    jacobian = np.zeros((6, plant.model.nv))

    def bear(moment_g_nm: np.ndarray, seconds: float) -> np.ndarray:
        for _ in range(round(seconds / plant.dt_s)):
            controller.wanted_rad[joints] = plant.data.qpos[robot.joint_qpos[joints]]
            torque, squeeze = controller.command()
            site = robot.gripper_sites[limb]
            mujoco.mj_jacSite(plant.model, plant.data, jacobian[:3], jacobian[3:], site)
            moment = plant.data.site_xmat[site].reshape(3, 3) @ moment_g_nm
            torque[joints] += jacobian[3:, robot.joint_dof[joints]].T @ moment
            plant.step(torque, squeeze)
        return np.array(plant.data.geom_xpos[robot.pad_geoms[2 * limb : 2 * limb + 2]])

    moment_g_nm = np.array([0.5, 0.3, 0.3])
    bear(np.zeros(3), 1.0)
    before = bear(moment_g_nm, 1.0)
    crept_m = np.linalg.norm(bear(moment_g_nm, 2.0) - before, axis=1)
    assert -plant.ft_true[6 * limb + 3] == pytest.approx(0.5, abs=0.05)
    assert crept_m.max() < 2.0 * 1e-3 / 100


def test_force_torque_is_the_world_on_the_hand_with_its_weight(standing: tuple[Plant, np.ndarray, np.ndarray]) -> None:
    plant, _, _ = standing
    gravity = Wall().gravity
    hands_kg = plant.model.body_subtreemass[plant.robot.gripper_bodies]
    rotations = plant.data.site_xmat[plant.robot.gripper_sites].reshape(4, 3, 3)
    total = sum(rotations[limb] @ plant.ft_true[6 * limb : 6 * limb + 3] for limb in range(4))
    np.testing.assert_allclose(total, -MASS_KG * gravity + hands_kg.sum() * gravity, atol=0.05)


def test_moment_of_the_hands_own_weight_about_the_gripper_centre() -> None:
    plan = standing_plan(Wall(slope_deg=90.0))
    for limb in plan.knots[0].limbs:
        limb.finger_separation_m += 0.03  # hands around the holds without touching; the belaying hand carries the body
    plant = Plant(build_model(SCALER, plan), plan, SEED)
    HoldingController(plant, squeeze_n=0.0, carries_body=False).run(0.3)
    assert plant.pad_face.max() == -1
    model, body = plant.model, plant.robot.gripper_bodies[0]
    lever_z = model.body_ipos[body][2] * model.body_mass[body] + 2 * 0.02 * 0.05  # URDF: fingers 0.05 kg at z 0.02
    moment = plant.ft_true[3:6]
    assert moment[1] == pytest.approx(-9.81 * lever_z, abs=0.005)  # r x m g with r = (0, 0, z), g = (-9.81, 0, 0)


def test_noise_and_bias_have_the_described_size() -> None:
    plant = make_plant()
    controller = HoldingController(plant)
    controller.run(2.0)
    errors = []
    for _ in range(1000):
        controller.run(plant.dt_s)
        errors.append(plant.ft - plant.ft_true)
    noise = np.std(errors, axis=0).reshape(4, 2, 3).mean(axis=(0, 2))
    described = SCALER.force_torque
    np.testing.assert_allclose(noise, [described.noise_N, described.noise_Nm], rtol=0.1)
    drawn = [make_plant(seed=seed) for seed in range(20)]
    biases = np.array([plant.ft - plant.ft_true for plant in drawn])
    spread = biases.reshape(20, 4, 2, 3).std(axis=(0, 1, 3))
    np.testing.assert_allclose(spread, [described.bias_N, described.bias_Nm], rtol=0.15)


def test_motor_torque_lags_by_its_time_constant() -> None:
    plant = make_plant()
    wanted = np.zeros(24)
    wanted[6] = 1.0
    plant.step(wanted, np.zeros(4))
    lag_s = SCALER.servo.torque_time_constant_s
    assert plant.joint_torque_nm[6] == pytest.approx(1 - np.exp(-plant.dt_s / lag_s))
    assert np.count_nonzero(plant.joint_torque_nm) == 1


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not() -> None:
    runs = []
    for seed in (SEED, SEED, SEED + 1):
        plant = make_plant(seed=seed)
        HoldingController(plant).run(1.0)
        runs.append((plant.data.qpos.tobytes(), plant.ft.tobytes()))
    assert runs[0] == runs[1]
    assert runs[0][1] != runs[2][1]


def test_start_out_of_reach_is_refused_by_name() -> None:
    far = Wall(xy_m=NOMINAL_M + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.3], [0.0, 0.0]]))
    with pytest.raises(StartPoseError, match="limb LR cannot take its start grasp"):
        make_plant(far)


def test_a_slippery_face_lets_go_where_its_neighbours_hold() -> None:
    """Holds whose x faces have no friction: grasped on x they sink to the wall, though top and y faces are rough."""
    slippery = make_plant(Wall(friction=(0.0, 0.0, 2.2, 2.2, 2.2), spines=(0,) * 5))
    HoldingController(slippery).run(3.0)
    rough = make_plant(Wall(friction=(2.2, 2.2, 0.0, 0.0, 0.0), spines=(0,) * 5))
    HoldingController(rough).run(3.0)
    sunk_m = PAD_HEIGHT_M - slippery.data.geom_xpos[slippery.robot.pad_geoms, 2]
    assert sunk_m.min() > 0.01
    assert rough.limbs_on_holds().all()
    assert np.linalg.norm(rough.data.qpos[:3] - [0, 0, BODY_HEIGHT_M]) < 0.01
