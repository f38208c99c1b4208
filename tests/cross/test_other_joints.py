"""Robots whose joints are described in another way are the same robots to the planner."""

from pathlib import Path

import numpy as np
import pytest
from broken_robots import ALRIGHT
from crux_contracts.robot import load_robot
from crux_planner.checker.limb_model import load_model
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.poses import posture
from crux_planner.model.problem import Pose

BODY = Pose(np.array([0.1, -0.05, 0.19]), np.zeros(3))
GRIPPERS = np.array(
    [
        [0.3, 0.33, 0.04, 0.2, 0.03],
        [0.3, -0.42, 0.03, -0.3, 0.03],
        [-0.1, 0.3, 0.03, 0.1, 0.03],
        [-0.1, -0.4, 0.04, 0, 0.03],
    ]
)


@pytest.mark.parametrize("change", ["axes turned around", "a fixed joint in between", "no axis on what stands still"])
def test_the_postures_put_the_grippers_where_they_should_be(change: str, tmp_path: Path) -> None:
    (case,) = (case for case in ALRIGHT if case.id == change)
    robot = load_robot(case.write(tmp_path))
    positions = posture(robot, BODY, GRIPPERS)
    for limb, gripper in zip(load_model(robot).limbs, GRIPPERS, strict=True):
        q_rad = np.array([[positions[joint.name] for joint in limb.joints]])
        assert ((q_rad >= limb.lower_rad) & (q_rad <= limb.upper_rad)).all()
        state = limb.forward(q_rad)
        assert state.link_position_m[limb.gripper][0] == pytest.approx(gripper[:3] - BODY.position_m, abs=1e-9)
        assert state.link_rotation[limb.gripper][0] == pytest.approx(rotation_z(gripper[3]), abs=1e-9)


def test_limits_are_those_of_the_shipped_robot(tmp_path: Path) -> None:
    (case,) = (case for case in ALRIGHT if case.id == "axes turned around")
    for one, other in zip(load_robot("scaler").limbs, load_robot(case.write(tmp_path)).limbs, strict=True):
        assert other.joints[1].lower == -one.joints[1].upper
        assert list(other.lower_rad) == list(one.lower_rad)
        assert list(other.upper_rad) == list(one.upper_rad)
