"""Robots as described on this machine: the one named, the one a plan was made for."""

from __future__ import annotations

from pathlib import Path

from crux_contracts.robot import Robot, load_robot, robot_names
from crux_msgs import plan_t

from crux_tools.errors import UsageError
from crux_tools.telemetry.description import SHOWN


def robot_named(name: str) -> Robot:
    """The robot that --robot names; raises UsageError when there is none."""
    if name not in robot_names():
        raise UsageError(f"--robot {name}: right is one of {', '.join(robot_names())}")
    return load_robot(name)


def robot_of_plan(plan: plan_t, path: Path) -> Robot:
    """Raises UsageError, naming the plan's file, when the robot is unknown or its description has changed since."""
    if plan.robot_name not in robot_names():
        raise UsageError(f"{path}: robot_name: {plan.robot_name!r}: expected one of {', '.join(robot_names())}")
    robot = load_robot(plan.robot_name)
    if plan.robot_sha256 != robot.hash:
        raise UsageError(
            f"{path}: robot_sha256: {plan.robot_sha256[:SHOWN]}…: {robot.name} in {robot.folder} has "
            f"{robot.hash[:SHOWN]}…; made with another robot description, or by an older crux: plan it again"
        )
    return robot
