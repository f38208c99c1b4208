"""The physics of a world that is not the plan, against statics and closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from crux_contracts.gripper_frames import yaw_and_tilt
from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_simulation.sim.climb import ClimbOptions, plant_of
from crux_simulation.sim.native import library
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.world_file import parse_world
from crux_simulation.sim.world_model import true_wall
from crux_tools.telemetry.rotations import rotation_from_rpy
from hand_plan import HALF_HOLD_M, MASS_KG, NOMINAL_M, PAD_HEIGHT_M, Wall, standing_plan
from holding_controller import HoldingController
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

SCALER = load_robot("scaler")
SETTLED_S = 4.0  # the hand is gone at 1.5 s
ENCODER_NOISE_RAD = 2e-4  # six standard deviations of a joint's reading


def in_world(text: str, plan: plan_t | None = None, seed: int = 3) -> Plant:
    """A plant on four holds h0..h3; `text`: sections of a world file."""
    plan = plan or standing_plan()
    world = parse_world(f"version: 1\nname: test\n{text}".encode()).draw(0, plan)
    return plant_of(plan, SCALER, ClimbOptions(seed=seed, world=world))


def carried_w(plant: Plant) -> Any:
    """(3,) Force of all holds on the robot, from the F/T sensors without their errors."""
    rotation = plant.data.site_xmat[plant.robot.gripper_sites].reshape(4, 3, 3)
    hands_kg = plant.model.body_subtreemass[plant.robot.gripper_bodies].sum()
    force = sum(rotation[limb] @ plant.ft_true[6 * limb : 6 * limb + 3] for limb in range(4))
    return force - hands_kg * plant.model.opt.gravity


def test_a_world_in_which_nothing_differs_is_the_plan_to_the_bit() -> None:
    plan = standing_plan()
    for text in ("", "holds: {all: {offset_m: [0, 0, 0]}}\nrobot: {joints: {all: {lag_s: 0}}, grippers: {all: {}}}\n"):
        plants = [in_world(text, plan), plant_of(plan, SCALER, ClimbOptions(seed=3))]
        for plant in plants:
            HoldingController(plant).run(1.0)
        first, second = ((p.data.qpos.tobytes(), p.data.qvel.tobytes(), p.ft.tobytes()) for p in plants)
        assert first == second


def test_a_payload_is_carried_and_moves_the_centre_of_mass() -> None:
    plant = in_world("robot: {payload: {mass_kg: 0.8, position_m: [0, 0.2, 0]}}\n")
    moved = plant.data.subtree_com[plant.robot.body] - in_world("").data.subtree_com[plant.robot.body]
    np.testing.assert_allclose(moved[:2], [0, 0.8 * 0.2 / (MASS_KG + 0.8)], atol=1e-6)
    HoldingController(plant).run(SETTLED_S)
    np.testing.assert_allclose(carried_w(plant), -(MASS_KG + 0.8) * Wall().gravity, atol=0.1)


def test_a_push_acts_from_its_beginning_to_its_end() -> None:
    plant = in_world(
        "pushes:\n  - {at_s: 3, for_s: 2, force_N: [0, 20, 0]}\n  - {at_s: 4, for_s: 1, force_N: [0, 0, 9]}\n"
    )
    control = HoldingController(plant)
    weight = -MASS_KG * Wall().gravity
    for until_s, push in ((2.9, [0, 0, 0]), (3.95, [0, 20, 0]), (4.95, [0, 20, 9]), (6.0, [0, 0, 0])):
        control.run(until_s - plant.time_s)
        np.testing.assert_allclose(carried_w(plant), weight - push, atol=0.3)


def test_a_hold_stands_where_the_world_has_it_and_the_robot_begins_on_it() -> None:
    wall = Wall(yaw_rad=np.array([0.3, 0.0, 0.0, 0.0]))
    plant = in_world(
        "holds: {h0: {offset_m: [0.01, 0, 0.002], yaw_deg: 5, size_change_m: [0.01, 0, 0]}}\n", standing_plan(wall)
    )
    body = plant.model.body("hold0")
    yaw = 0.3 + math.radians(5)
    place = [0.14 + 0.01 * math.cos(0.3), 0.36 + 0.01 * math.sin(0.3), 0.002]
    np.testing.assert_allclose(body.pos, place, atol=1e-12)
    np.testing.assert_allclose(body.quat, [math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)], atol=1e-12)
    np.testing.assert_allclose(
        plant.data.site_xpos[plant.robot.gripper_sites[0]], place + np.array([0, 0, PAD_HEIGHT_M]), atol=1e-5
    )
    np.testing.assert_allclose(plant.finger_opening_m, [HALF_HOLD_M + 0.005, *[HALF_HOLD_M] * 3], atol=1e-9)
    np.testing.assert_allclose(plant.model.body("hold1").pos[:2], NOMINAL_M[1])
    turned = plant.data.site_xmat[plant.robot.gripper_sites[0]].reshape(3, 3)
    np.testing.assert_allclose(turned, rotation_from_rpy([0, 0, yaw]), atol=1e-5)
    HoldingController(plant).run(SETTLED_S)
    assert plant.limbs_on_holds().all()


def test_a_hold_out_of_the_walls_plane_lies_elsewhere_along_its_own_axes() -> None:
    """And the gripper that holds it goes with it: 5 and 2 mm along its surface, 3 degrees about its own z."""
    plan = standing_plan()
    hold, grip = plan.holds[0], plan.knots[0].limbs[0]
    hold.tilt_rad = [0.0, -0.8]
    of_hold = Rotation.from_euler("ZYX", [hold.yaw_rad, -0.8, 0.0])
    yaw, tilt = yaw_and_tilt((of_hold * Rotation.from_euler("z", grip.gripper_yaw_w_rad - hold.yaw_rad)).as_matrix())
    grip.gripper_yaw_w_rad, grip.gripper_tilt_w_rad = yaw, tilt.tolist()
    text = "version: 1\nname: test\nholds: {h0: {offset_m: [0.005, 0.002, 0], yaw_deg: 3}}\n"
    true = true_wall(plan, parse_world(text.encode()).draw(0, plan))
    there, held = true.holds[0], true.knots[0].limbs[0]
    off_m = of_hold.inv().apply(np.subtract(there.position_w_m, hold.position_w_m))
    np.testing.assert_allclose(off_m, [0.005, 0.002, 0.0], atol=1e-12)
    turned = of_hold.inv() * Rotation.from_euler("ZYX", [there.yaw_rad, *there.tilt_rad[::-1]])
    np.testing.assert_allclose(turned.as_rotvec(degrees=True), [0.0, 0.0, 3.0], atol=1e-9)
    grips = [Rotation.from_rotvec([*g.gripper_tilt_w_rad, 0.0]) * Rotation.from_euler("z", g.gripper_yaw_w_rad)
             for g in (grip, held)]  # fmt: skip
    np.testing.assert_allclose((grips[0].inv() * grips[1]).as_rotvec(degrees=True), [0.0, 0.0, 3.0], atol=1e-9)


def test_friction_and_spines_by_face() -> None:
    plant = in_world(
        "holds:\n  all: {friction_factor: 0.5}\n  h1: {friction: {+x: 0.4}, friction_factor: 1}\n"
        "  h2: {spines: false}\n"
    )
    found = {face.geom: (face.friction, face.spines) for face in plant.robot.faces}
    assert found["hold0"] == (1.1, True)
    assert found["hold1+x"] == (0.4, True)
    assert found["hold1-x"] == (2.2, True)
    assert found["hold2"] == (1.1, False)
    pairs = {
        plant.model.geom(plant.model.pair_geom2[i]).name: plant.model.pair_friction[i][0]
        for i in range(plant.model.npair)
    }
    assert pairs["hold0"] == 1.1
    assert pairs["hold1+x"] == 0.4


@pytest.mark.parametrize(
    ("change", "lost_s"),
    [("present: false", 0.0), ("breaks_at_s: 3", 3.0), ("breaks_at_N: 12", 0.5), ("breaks_at_N: 500", None)],
)
def test_a_hold_that_is_gone_touches_nothing(change: str, lost_s: float | None) -> None:
    plant = in_world(f"holds: {{h3: {{{change}}}}}\n")
    control = HoldingController(plant)
    gone_s = None
    for _ in range(round(SETTLED_S / plant.dt_s)):
        control.run(plant.dt_s)
        if gone_s is None and plant.time_s > 0.5 and plant.pad_face[6:].max() < 0:
            gone_s = plant.time_s
    assert plant.limbs_on_holds().tolist()[:3] == [True] * 3
    if lost_s is None:
        assert gone_s is None
    else:
        assert gone_s is not None
        assert max(lost_s, 0.5) <= gone_s <= max(lost_s, 0.5) + 1.0


def test_a_hold_that_gives_moves_by_its_load_over_its_stiffness() -> None:
    plant = in_world("holds: {h0: {stiffness_N_m: 20000}, h2: {stiffness_N_m: 4000}}\n")
    HoldingController(plant).run(SETTLED_S)
    rotation = plant.data.site_xmat[plant.robot.gripper_sites].reshape(4, 3, 3)
    hand_N = plant.model.body_subtreemass[plant.robot.gripper_bodies][:, None] * plant.model.opt.gravity
    load_N = hand_N - np.einsum("lij,lj->li", rotation, plant.ft_true.reshape(4, 6)[:, :3])
    for limb, stiffness in ((0, 20000.0), (2, 4000.0)):
        hold = plant.model.body(f"hold{limb}")
        moved_m = plant.data.xpos[hold.id] - hold.pos
        assert np.linalg.norm(moved_m) > 1e-4
        np.testing.assert_allclose(moved_m, load_N[limb] / stiffness, atol=float(0.02 * np.linalg.norm(moved_m)))
    assert plant.limbs_on_holds().all()
    assert not plant.model.body("hold1").jntnum


def test_a_hold_in_a_viscous_mount_creeps_at_its_load_over_its_viscosity() -> None:
    viscosity = 40000.0
    plant = in_world(f"holds: {{h0: {{viscosity_Ns_m: {viscosity}}}}}\n")
    controller = HoldingController(plant)
    controller.run(SETTLED_S)
    hold = plant.model.body("hold0")
    rotation = plant.data.site_xmat[plant.robot.gripper_sites].reshape(4, 3, 3)
    hand_N = plant.model.body_subtreemass[plant.robot.gripper_bodies[0]] * plant.model.opt.gravity
    load_N = hand_N - rotation[0] @ plant.ft_true[:3]
    before_m, begun_s = plant.data.xpos[hold.id].copy(), plant.time_s
    controller.run(0.2)
    crept_m_s = (plant.data.xpos[hold.id] - before_m) / (plant.time_s - begun_s)
    assert np.linalg.norm(crept_m_s) > 1e-4
    np.testing.assert_allclose(crept_m_s, load_N / viscosity, atol=float(0.05 * np.linalg.norm(crept_m_s)))
    assert not plant.model.body("hold1").jntnum


def test_a_hold_bears_the_net_force_of_its_contacts_and_not_the_squeeze() -> None:
    """20 N a finger and 3 N of load: a hold that breaks at 40 N stays, though its contacts have 40 N and more."""
    plant = in_world("holds: {all: {breaks_at_N: 39}}\n")
    HoldingController(plant, squeeze_n=25.0).run(SETTLED_S)
    assert plant.pad_force_n.reshape(4, 2).sum(axis=1).min() > 39
    assert plant.limbs_on_holds().all()


FROM_S, UNTIL_S, END_S = 0.1, 0.2, 0.3
RANGE = np.repeat([SCALER.force_torque.range_N, SCALER.force_torque.range_Nm], 3)
Readings = NDArray[np.float64]


def readings(text: str) -> tuple[Readings, Readings, Readings]:
    """Times (n,) and the readings of RF's force/torque sensor (n, 6) in a world and, with the same noise, without."""
    told = []
    for plant in (in_world(text), in_world("")):
        control = HoldingController(plant)
        rows = []
        for _ in range(round(END_S / plant.dt_s)):
            control.run(plant.dt_s)
            rows.append([plant.time_s, *plant.ft[6:12]])
        told.append(np.array(rows))
    return told[0][:, 0], told[0][:, 1:], told[1][:, 1:]


def _cross_talk(true: Readings, _time_s: Readings) -> Readings:
    shares = true / RANGE
    return np.asarray(true + 0.1 * RANGE * (shares.sum(axis=1, keepdims=True) - shares))


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ("bias, N: [1, 2, 3], Nm: [0.1, 0.2, 0.3]", lambda true, _: true + np.array([1, 2, 3, 0.1, 0.2, 0.3])),
        ("jump, Nm: [0.1, 0, 0]", lambda true, _: true + np.array([0, 0, 0, 0.1, 0, 0])),
        ("drift, N: [10, 0, 0]", lambda true, t: true + np.outer(t - FROM_S, [10, 0, 0, 0, 0, 0])),
        ("saturation, N: [1, 1, 1]", lambda true, _: np.clip(true, [-1, -1, -1, *[-9] * 3], [1, 1, 1, *[9] * 3])),
        ("scale, factor: 0.9", lambda true, _: 0.9 * true),
        ("cross_talk, share: 0.1", _cross_talk),
        ("freeze", lambda true, t: np.repeat(true[:1] * 0 + true[0], len(t), axis=0)),
        ("zero", lambda true, _: 0 * true),
        ("nan", lambda true, _: np.nan * true),
    ],
)
def test_a_sensor_errs_as_told_for_as_long_as_told(error: str, expected: Callable[..., Any]) -> None:
    window = f"from_s: {FROM_S}, for_s: {UNTIL_S - FROM_S}"
    time_s, told, true = readings(f"sensors:\n  - {{sensor: force_torque, on: RF, error: {error}, {window}}}\n")
    on = (time_s >= FROM_S - 1e-9) & (time_s < UNTIL_S - 1e-9)
    np.testing.assert_array_equal(told[~on], true[~on])
    wanted = expected(true[on], time_s[on])
    if error == "freeze":  # at what it had read last
        wanted[:] = true[np.argmax(on) - 1]
    np.testing.assert_allclose(told[on], wanted, atol=1e-12)


def test_lost_samples_leave_the_one_before() -> None:
    _, told, true = readings("sensors:\n  - {sensor: force_torque, on: RF, error: dropout, share: 0.3}\n")
    fresh = (told == true).all(axis=1)
    assert fresh.mean() == pytest.approx(0.7, abs=0.12)
    for row in np.flatnonzero(~fresh[1:]) + 1:
        np.testing.assert_array_equal(told[row], told[row - 1])


def test_errors_add_up_in_their_order_and_concern_their_own_sensor() -> None:
    entry = "  - {sensor: force_torque, on: RF, error: "
    bias, scale = entry + "bias, N: [1, 1, 1]}\n", entry + "scale, factor: 2}\n"
    _, first, true = readings(f"sensors:\n{bias}{scale}")
    _, second, _ = readings(f"sensors:\n{scale}{bias}")
    np.testing.assert_allclose(first[:, :3], 2 * (true[:, :3] + 1), atol=1e-12)
    np.testing.assert_allclose(second[:, :3], 2 * true[:, :3] + 1, atol=1e-12)
    _, other, same = readings("sensors:\n  - {sensor: force_torque, on: LF, error: zero}\n")
    np.testing.assert_array_equal(other, same)


def test_encoders_and_fingers_err_in_place_and_rate() -> None:
    plant = in_world(
        "sensors:\n  - {sensor: encoder, on: RF.2, error: bias, rad: 0.01}\n"
        "  - {sensor: encoder, on: LR, error: nan}\n  - {sensor: encoder, on: RR.1, error: freeze, from_s: 0.1}\n"
        "  - {sensor: finger_opening, on: LF, error: bias, m: 0.002}\n"
        "  - {sensor: finger_force, on: RF, error: scale, factor: 0.5}\n"
    )
    held = plant.data.qpos[plant.robot.joint_qpos]
    torque, last = np.zeros(24), np.zeros(24)
    for step in range(100):
        plant.step(torque, np.full(4, 8.0))
        if step == 48:  # the sample before 0.1 s
            last = plant.joint_position_rad.copy()
    true = plant.data.qpos[plant.robot.joint_qpos]
    assert abs(true[18] - held[18]) > 1e-4  # the joints give way
    errors = plant.joint_position_rad - true
    assert errors[7] == pytest.approx(0.01, abs=ENCODER_NOISE_RAD)
    assert np.isnan(errors[12:18]).all()
    assert np.isnan(plant.joint_velocity_rad_s[12:18]).all()
    assert plant.joint_position_rad[18] == last[18]
    assert plant.joint_velocity_rad_s[18] == 0.0
    assert np.abs(errors[[*range(7), *range(8, 12), *range(19, 24)]]).max() < ENCODER_NOISE_RAD
    opening = plant.data.qpos[plant.robot.finger_qpos].mean(axis=1)
    np.testing.assert_allclose(plant.finger_opening_m - opening, [0.002, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(plant.finger_force_n, [8, 4, 8, 8])


def test_a_motor_is_slow_late_and_limited_before_its_current_is_read_and_weak_after() -> None:
    plant = in_world("robot: {joints: {all: {lag_s: 0.01, dead_cycles: 3, torque_limit_Nm: 2, torque_factor: 0.5}}}\n")
    tau_s, lag_s, dt_s = SCALER.servo.torque_time_constant_s, 0.01, plant.dt_s
    told = np.full(24, 5.0)
    current, lagged = 0.0, 0.0
    for step in range(40):
        plant.step(told, np.zeros(4))
        if step >= 3:  # two lags in a row, exactly sampled, of a step that ends at 2 Nm
            lagged += (1 - math.exp(-dt_s / lag_s)) * (2.0 - lagged)
            current += (1 - math.exp(-dt_s / tau_s)) * (lagged - current)
        np.testing.assert_allclose(plant.joint_torque_nm, current, atol=1e-12)
        np.testing.assert_allclose(plant.data.ctrl[plant.robot.joint_actuators], 0.5 * current, atol=1e-12)
    assert 1.9 < current < 2.0


def in_the_air(text: str) -> Plant:
    """The hand holds the body, no hold is there, and the limbs hang free."""
    return in_world(f"holds: {{all: {{present: false}}}}\n{text}")


def drive(plant: Plant, joint: int, torque_nm: float, seconds: float) -> float:
    """Angle [rad] by which a joint moves under a torque besides that which carries it; the other joints hold."""
    control = HoldingController(plant, squeeze_n=0.0, carries_body=False)
    place = plant.robot.joint_qpos[joint]
    begin = float(plant.data.qpos[place])
    for _ in range(round(seconds / plant.dt_s)):
        torque, force = control.command()
        torque[joint] = plant.data.qfrc_bias[plant.robot.joint_dof[joint]] + torque_nm
        plant.step(torque, force)
    return float(plant.data.qpos[place]) - begin


def test_a_joint_sticks_until_the_torque_breaks_it_away_and_then_slides() -> None:
    text = "robot: {joints: {LF.1: {friction_Nm: 0.6, stiction_Nm: 0.6}}}\n"
    plant, free = in_the_air(text), in_the_air("")
    for other in (plant, free):
        drive(other, 0, 0.0, 0.2)
    assert abs(drive(plant, 0, 1.0, 0.1)) < 1e-4
    assert drive(free, 0, 1.0, 0.1) > 1e-2
    assert drive(plant, 0, 2.0, 0.1) > 1e-2
    assert drive(plant, 0, 1.0, 0.1) > 1e-2  # more than friction, less than it takes to break away


def _between(plant: Plant, torques_nm: tuple[float, float]) -> tuple[float, float]:
    """Angles of what lies between motor and link of LF.2 under torques on the link, once at rest."""
    joint = plant.model.joint(SCALER.limbs[0].joint_names[1])
    play = plant.model.joint(f"{joint.name}_play")
    control = HoldingController(plant, squeeze_n=0.0, carries_body=False)
    angles = []
    for torque_nm in torques_nm:
        for _ in range(250):
            plant.data.xfrc_applied[joint.bodyid[0], 3:] = torque_nm * plant.data.xaxis[joint.id]
            control.run(plant.dt_s)
        angles.append(float(plant.data.qpos[play.qposadr[0]]))
    return angles[0], angles[1]


def test_play_lets_the_link_move_from_stop_to_stop_behind_the_encoder() -> None:
    plant = in_the_air("robot: {joints: {LF.2: {backlash_rad: 0.02}}}\n")
    np.testing.assert_allclose(_between(plant, (-6.0, 6.0)), (-0.01, 0.01), atol=4e-4)


@pytest.mark.parametrize("stiffness", [400, 4000])
def test_an_elastic_joint_gives_by_torque_over_stiffness(stiffness: int) -> None:
    plant = in_the_air(f"robot: {{joints: {{LF.2: {{stiffness_Nm_rad: {stiffness}}}}}}}\n")
    low, high = _between(plant, (-2.0, 2.0))
    assert high - low == pytest.approx(4.0 / stiffness, rel=0.02)


def test_an_elastic_joint_with_play_gives_both() -> None:
    plant = in_the_air("robot: {joints: {LF.2: {stiffness_Nm_rad: 400, backlash_rad: 0.02}}}\n")
    low, high = _between(plant, (-6.0, 6.0))
    assert high - low == pytest.approx(0.02 + 12.0 / 400, rel=0.02)


def test_the_robot_stands_with_play_and_elasticity_in_every_joint() -> None:
    plant = in_world("robot: {joints: {all: {backlash_rad: 0.003, stiffness_Nm_rad: 1000, friction_Nm: 0.1}}}\n")
    control = HoldingController(plant)
    control.run(SETTLED_S)
    carried = []
    for _ in range(1000):  # it sways within its play
        control.run(plant.dt_s)
        carried.append(carried_w(plant))
    assert plant.limbs_on_holds().all()
    np.testing.assert_allclose(np.mean(carried, axis=0), -MASS_KG * Wall().gravity, atol=0.3)
    assert np.abs(plant.data.qvel).max() < 0.05


def test_fingers_are_weak_limited_and_jam() -> None:
    plant = in_the_air(
        "robot:\n  grippers:\n    LF: {force_factor: 0.5, force_limit_N: 10}\n    RF: {jams_at_m: 0.035}\n"
        "    RR: {jams_at_s: 0.04}\n"
    )
    for _ in range(200):
        plant.step(np.zeros(24), np.full(4, -20.0))  # open
    np.testing.assert_allclose(plant.finger_force_n, [-10, -20, -20, -20])
    np.testing.assert_allclose(plant.data.ctrl[plant.robot.finger_actuators].T, [[5, 20, 20, 20]] * 2)
    opening = plant.finger_opening_m
    assert opening[2] > 0.045  # LR is as it should be
    assert opening[1] == pytest.approx(0.035, abs=1e-3)
    assert HALF_HOLD_M + 1e-3 < opening[3] < 0.045
    before = opening.copy()
    for _ in range(200):
        plant.step(np.zeros(24), np.full(4, 60.0))  # and close
    np.testing.assert_allclose(plant.finger_opening_m[[1, 3]], before[[1, 3]], atol=2e-4)
    assert plant.finger_opening_m[2] < before[2] - 0.01


def test_a_motor_warms_with_its_torque_squared() -> None:
    plant = in_the_air("robot: {ambient_degC: 30, joints: {RF.3: {heating_K_Nm2: 5, heating_time_s: 0.2}}}\n")
    for _ in range(50):
        plant.step(np.full(24, 2.0), np.zeros(4))
    read = library().crux_plant_temperature(plant.handle)
    told = np.ctypeslib.as_array(read, (24,))
    assert told[8] == pytest.approx(30 + 20 * (1 - math.exp(-0.1 / 0.2)), rel=0.02)
    assert np.isnan(np.delete(told, 8)).all()
    assert not library().crux_plant_temperature(in_the_air("").handle)
