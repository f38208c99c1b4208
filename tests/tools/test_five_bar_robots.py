"""A robot with five-bars: physics with constraints that close them, a climb, and what check and show say."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from climbs import climbs_and_replays
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import parse_scenario
from crux_simulation.sim.world import JointChange, World
from crux_simulation.sim.world_model import change_robot
from crux_tools import cli
from crux_tools.report.pictures import place_measured
from crux_tools.robot.described import described
from crux_tools.robot3d.linkages import close_linkages
from crux_tools.robot3d.robot_model import RobotModel, build_model
from crux_tools.telemetry import read_log
from crux_tools.telemetry.actuators import joint_speeds_rad_s, joints_rad
from crux_tools.view.robot.figure import Figure
from geared_robots import FIVE_BAR, with_five_bars
from hand_plan import standing_plan
from shared_plans import unproven
from short_climb import scenario_text


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(with_five_bars(tmp_path_factory.mktemp("robot")))


def posture(robot: Robot, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.array([[random.uniform(j.lower, j.upper) for j in limb.joints] for limb in robot.limbs])


def rods_off_m(model: RobotModel, data: mujoco.MjData) -> np.ndarray:
    lengths = [data.ten_length[model.model.tendon(f"{limb.name}/crank/rod").id] for limb in model.robot.limbs]
    return np.abs(np.array(lengths) - FIVE_BAR["rod_m"])


def actuators_of(robot: Robot, q_rad: np.ndarray) -> np.ndarray:
    each = zip(robot.limbs, q_rad.reshape(4, 6), strict=True)
    return np.array([limb.transmission.actuators_rad(q) for limb, q in each])


def test_play_of_a_cranks_drive_lets_the_crank_move_behind_its_motor(robot: Robot) -> None:
    """How far, from where the elbow goes as its link is pushed to and fro while all motors stand."""
    world = World("loose", "", 0, joints={"LF.3": JointChange(backlash_rad=0.02)})
    model = build_model(robot, standing_plan(), lambda spec: change_robot(spec, robot, world))
    data = mujoco.MjData(model.model)
    model.model.opt.gravity[:] = 0.0
    model.model.dof_damping[[*range(6), *model.driven_dof]] = 1e7
    data.qpos[2] = 1.0  # off the wall
    data.qpos[model.joint_qpos] = posture(robot, 1).ravel()
    close_linkages(robot, model.model, data)
    elbow, cranks, plays = model.model.joint(robot.limbs[0].joint_names[2]), [], []
    for torque_Nm in (-2.0, 2.0):
        for _ in range(400):
            data.xfrc_applied[elbow.bodyid[0], 3:] = torque_Nm * data.xaxis[elbow.id]
            mujoco.mj_step(model.model, data)
        cranks.append(actuators_of(robot, data.qpos[model.joint_qpos])[0, 2])
        plays.append(data.joint("LF/crank_play").qpos[0])
        assert rods_off_m(model, data).max() < 2e-4
    np.testing.assert_allclose(sorted(plays), (-0.01, 0.01), atol=4e-4)
    assert abs(cranks[1] - cranks[0]) == pytest.approx(0.02, abs=2.5e-3)  # the rod gives by 0.8 mrad to either side


@pytest.mark.parametrize("seed", range(3))
def test_the_linkage_is_where_the_rod_has_its_length(robot: Robot, seed: int) -> None:
    """By the lengths that MuJoCo finds between the points, in limbs that are mirror images of each other."""
    model = build_model(robot, standing_plan())
    data = mujoco.MjData(model.model)
    data.qpos[model.joint_qpos] = (q := posture(robot, seed)).ravel()
    close_linkages(robot, model.model, data)
    mujoco.mj_forward(model.model, data)
    assert rods_off_m(model, data).max() < 1e-12
    told = data.qpos[model.driven_qpos] * model.ratio + model.offset_rad
    np.testing.assert_allclose(told.reshape(4, 6), actuators_of(robot, q), atol=1e-12)
    assert model.model.body_subtreemass[model.body] == pytest.approx(robot.total_mass_kg, abs=1e-5)


def test_actuators_hold_what_statics_asks_of_them(robot: Robot) -> None:
    """Motors hold the limbs against gravity, through rods; body and fingers are so heavy that they stand still."""
    model, mass_kg = build_model(robot, standing_plan()), 1e6
    model.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.model.body_mass[model.body], model.model.body_inertia[model.body] = mass_kg, mass_kg
    model.model.dof_armature[model.finger_dof] = mass_kg
    data = mujoco.MjData(model.model)
    mujoco.mj_setConst(model.model, data)
    data.xfrc_applied[model.body, :3] = -mass_kg * model.model.opt.gravity
    q = np.array([0.3, 1.0, 1.6, 0.4, 0.2, 0.1])
    data.qpos[model.joint_qpos] = np.tile(q, 4)
    close_linkages(robot, model.model, data)
    wanted, gain, farthest_m = data.qpos[model.driven_qpos].copy(), 400.0, 0.0
    for _ in range(1500):
        off = wanted - data.qpos[model.driven_qpos]
        data.ctrl[model.joint_actuators] = (gain * off - 8.0 * data.qvel[model.driven_dof]) / model.ratio
        mujoco.mj_step(model.model, data)
        farthest_m = max(farthest_m, float(rods_off_m(model, data).max()))
    mujoco.mj_forward(model.model, data)
    assert np.abs(data.qvel[model.driven_dof]).max() < 1e-3
    assert farthest_m < 1e-4
    weight_Nm = data.qfrc_bias[model.joint_dof].reshape(4, 6)
    assert np.abs(weight_Nm[:, 2]).min() > 0.5
    held_Nm = data.ctrl[model.joint_actuators].reshape(4, 6)
    for limb, joints, torque, held in zip(
        robot.limbs, data.qpos[model.joint_qpos].reshape(4, 6), weight_Nm, held_Nm, strict=True
    ):
        np.testing.assert_allclose(held, limb.transmission.actuator_torque_Nm(joints, torque), rtol=3e-3, atol=3e-3)


def test_a_robot_with_five_bars_climbs(robot: Robot, tmp_path: Path) -> None:
    """It is planned, checked, climbed, computed again from the log, and shown."""
    path = tmp_path / "log.mcap"
    found = unproven(parse_scenario(scenario_text()), robot)
    assert any(each.constraint == "linkage_singular" for each in found.check.worst)
    climbs_and_replays(found, robot, path)
    log = read_log(path)
    model = build_model(robot, standing_plan())
    data = mujoco.MjData(model.model)
    place_measured(model, data, log, len(log.time_s) - 1)
    told = log.inputs["joint_position_rad"][-1]
    np.testing.assert_allclose(told, actuators_of(robot, data.qpos[model.joint_qpos]).ravel(), atol=1e-9)
    mujoco.mj_kinematics(model.model, data)
    grippers = data.site_xpos[model.gripper_sites]
    np.testing.assert_allclose(grippers, log.limbs["gripper_position_w_m"][-1], atol=2e-3)


def test_speeds_of_joints_in_logs_are_how_their_angles_change(robot: Robot) -> None:
    q, ways, step = posture(robot, 4).ravel(), posture(robot, 5).ravel(), 1e-6
    there = [actuators_of(robot, q + sign * step * ways).ravel() for sign in (-1, 1)]
    found = joint_speeds_rad_s(robot, actuators_of(robot, q).ravel(), (there[1] - there[0]) / (2 * step))
    np.testing.assert_allclose(found, ways, atol=1e-5)
    np.testing.assert_allclose(joints_rad(robot, actuators_of(robot, q).ravel()), q, atol=1e-9)


def test_robot_check_says_what_is_left(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["robot", "check", str(robot.folder), "--json"]) == 0
    checks = {check["topic"]: check["found"] for check in json.loads(capsys.readouterr().out)["checks"]}
    assert "LF_joint3 0.667..2.75 of 0.25..2.75 rad" in checks["five-bar"]
    assert "peak 12, 24, 24, 6, 6, 6 Nm" in checks["limits"]


def test_robot_show_loads_no_posture_that_the_linkage_does_not_have(robot: Robot) -> None:
    figure = Figure(described(str(robot.folder)), 2.2)
    q = [[float(joint["start"]) for joint in limb["joints"]] for limb in figure.told()["limbs"]]
    assert "shares" in figure.at(q, 0.04, 45.0, None)["loads"]
    q[1][1:3] = [-1.2, 2.75]
    assert figure.at(q, 0.04, 45.0, None)["loads"]["why"].startswith("RF: ")
