"""Robots whose actuators are not their joints: planned, checked, climbed, and recomputed from the log."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from climbs import climbs_and_replays
from crux_contracts.joint_loop_checks import borne_dead_time_s
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import parse_scenario
from crux_simulation.sim.climb import ClimbOptions, plant_of
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.world import JointChange, World
from crux_simulation.sim.world_file import parse_world
from crux_simulation.sim.world_model import change_robot
from crux_tools.errors import UsageError
from crux_tools.report.pictures import place_measured
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry import read_log
from geared_robots import COUPLED, GEARED, OFFSET_RAD, RATIO, with_transmissions
from hand_plan import standing_plan
from shared_plans import unproven
from short_climb import scenario_text


def test_gears_that_leave_the_joints_as_they_are_leave_the_delay_margin(tmp_path: Path) -> None:
    geared, plain = load_robot(with_transmissions(GEARED, tmp_path)), load_robot("scaler")
    assert borne_dead_time_s(geared) == pytest.approx(borne_dead_time_s(plain), rel=1e-3)


@pytest.mark.parametrize("section", [GEARED, COUPLED], ids=["geared", "coupled"])
def test_physics_turns_joints_by_the_power_of_actuators(section: dict[str, Any], tmp_path: Path) -> None:
    """One actuator after the other, in MuJoCo: its length is its angle, and power in is power out."""
    robot = load_robot(with_transmissions(section, tmp_path))
    model = build_model(robot, standing_plan())
    data = mujoco.MjData(model.model)
    random = np.random.default_rng(4)
    data.qpos[model.joint_qpos] = random.uniform(-0.5, 0.5, 24)
    data.qvel[model.joint_dof] = random.uniform(-1.0, 1.0, 24)
    data.ctrl[model.joint_actuators] = torque = random.uniform(-2.0, 2.0, 24)
    mujoco.mj_forward(model.model, data)
    speeds = data.actuator_velocity[model.joint_actuators]
    for i, limb in enumerate(robot.limbs):
        own, of = slice(6 * i, 6 * i + 6), limb.transmission
        q, dq = data.qpos[model.joint_qpos[own]], data.qvel[model.joint_dof[own]]
        angles = data.actuator_length[model.joint_actuators[own]] + of.offset_rad
        np.testing.assert_allclose(of.actuators_rad(q), angles, atol=1e-12)
        np.testing.assert_allclose(of.slope(q) @ dq, speeds[own], atol=1e-12)
        made = data.qfrc_actuator[model.joint_dof[own]]
        np.testing.assert_allclose(of.joint_torque_Nm(q, torque[own]), made, atol=1e-12)
        assert made @ dq == pytest.approx(torque[own] @ speeds[own])


def _in_the_air(robot: Robot, drive: Callable[[float], dict[str, float]]) -> Plant:
    """With `drive(ratio)` in every drive of its front left limb."""
    joints = {f"LF.{number}": drive(ratio) for number, ratio in enumerate(_ratios_of(robot), 1)}
    text = json.dumps({"version": 1, "name": "x", "holds": {"all": {"present": False}}, "robot": {"joints": joints}})
    plan = standing_plan()
    return plant_of(plan, robot, ClimbOptions(seed=3, world=parse_world(text.encode()).draw(0, plan)))


def _ratios_of(robot: Robot) -> list[float]:
    return [float(ratio) for ratio in np.diag(robot.limbs[0].transmission.matrix)]


@pytest.mark.parametrize("stiffness", [{}, {"stiffness_Nm_rad": 400.0}], ids=["rigid", "elastic"])
def test_play_friction_and_elasticity_behind_gears_are_those_of_a_joint(
    stiffness: dict[str, float], tmp_path: Path
) -> None:
    """Motions of the geared robot and of the plain one, in whose joints the same lies, for the same power."""

    def drive(ratio: float) -> dict[str, float]:
        turned = {"backlash_rad": 0.02 * abs(ratio), "friction_Nm": 0.1 / abs(ratio), "stiction_Nm": 0.1 / abs(ratio)}
        return turned | {key: value / ratio**2 for key, value in stiffness.items()}

    torque, motions = np.random.default_rng(5).uniform(-2.0, 2.0, (100, 24)), []
    for robot in (load_robot("scaler"), load_robot(with_transmissions(GEARED, tmp_path))):
        plant, ratio = _in_the_air(robot, drive), np.tile(_ratios_of(robot), 4)
        for told in torque:
            plant.step(told / ratio, np.zeros(4))
        plays = [plant.model.joint(f"{name}_play").qposadr[0] for name in robot.limbs[0].joint_names]
        motions.append(plant.data.qpos[[*plant.robot.joint_qpos, *plays]])
    np.testing.assert_allclose(motions[1], motions[0], atol=1e-7)
    assert np.abs(motions[0][24:]).max() > 0.005, "links moved against their motors"


def test_play_behind_a_drive_of_two_joints_is_refused(tmp_path: Path) -> None:
    robot = load_robot(with_transmissions(COUPLED, tmp_path))

    def changed(place: str, change: JointChange) -> None:
        world = World("changed", "", 0, joints={place: change})
        build_model(robot, standing_plan(), lambda spec: change_robot(spec, robot, world))

    with pytest.raises(UsageError, match=r"joints\.LF\.3: no friction, play or elasticity in drives that move two"):
        changed("LF.3", JointChange(backlash_rad=0.01))
    changed("LF.2", JointChange(backlash_rad=0.01))
    changed("LF.3", JointChange(torque_factor=0.8))


def test_a_robot_with_gears_signs_offsets_and_a_belt_climbs(tmp_path: Path) -> None:
    """It is planned, checked, climbed, computed again from the log, and shown."""
    robot, path = load_robot(with_transmissions(COUPLED, tmp_path)), tmp_path / "log.mcap"
    found = unproven(parse_scenario(scenario_text()), robot)
    assert len(found.check.actuators) == 24
    climbs_and_replays(found, robot, path)
    log = read_log(path)
    told = log.inputs["joint_position_rad"][-1].reshape(4, 6)
    model = build_model(robot, standing_plan())
    data = mujoco.MjData(model.model)
    place_measured(model, data, log, len(log.time_s) - 1)
    joints = data.qpos[model.joint_qpos].reshape(4, 6)
    belt = np.zeros((4, 6))
    belt[:, 2] = -0.6 * joints[:, 1]
    np.testing.assert_allclose(told, joints * RATIO + belt + OFFSET_RAD, atol=1e-12)
    mujoco.mj_kinematics(model.model, data)
    grippers = data.site_xpos[model.gripper_sites]
    np.testing.assert_allclose(grippers, log.limbs["gripper_position_w_m"][-1], atol=2e-3)
