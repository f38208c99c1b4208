"""What is made easier, one thing at a time, to see which gives a plan: obstacles, grippers, friction, motors, reach."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.scenario import Scenario
from crux_contracts.scenario_document import change_friction, foot_of, set_foot
from crux_contracts.scenario_types import MAX_FRICTION, SIZE_M
from crux_msgs.robot_keys import Transmissions

from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.pipeline.restart import edited
from crux_planner.pipeline.solve_and_check import Climb
from crux_planner.search.stances import Oracles
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.swing.swing_cache import SwingCache

_TORQUES = ("torque", "torque_shared", "torque_uncertain")
_JOINTS = tuple(f"{what}_{torque}" for what in ("joint", "actuator") for torque in _TORQUES)  # of the check


@dataclass(frozen=True)
class Relaxation:
    """Up to `most` steps of `step` on from `given` are tried; `text` says what they amount to.

    `whole`: scenario or robot are others then, so that a plan can be made and checked.
    """

    constraint: str
    unit: str
    given: float
    step: float
    most: int
    relaxed: Callable[[Climb, float], Climb]
    text: Callable[[float], str]
    whole: bool = True

    def amount(self, count: int) -> float:
        """Of so many steps."""
        return round(self.given + count * self.step, 3)

    def climb(self, climb: Climb, count: int) -> Climb:
        """The climb with so many steps of it. Raises ScenarioError and InfeasibleError."""
        return self.relaxed(climb, self.amount(count))

    def is_about(self, constraint: str) -> bool:
        """Whether that is what a failure names."""
        if constraint in _JOINTS:
            return self.constraint == "torque"
        return self.constraint == ("equilibrium" if constraint.startswith("limit_surface") else constraint)


def relaxations(climb: Climb, constraint: str, folder: Path) -> list[Relaxation]:
    """In order of likelihood; what a failure names comes first. Other robots' files go to `folder`."""
    return sorted(_all(climb.session.scenario, folder), key=lambda each: not each.is_about(constraint))


def _all(scenario: Scenario, folder: Path) -> Iterator[Relaxation]:
    for obstacle in scenario.obstacles:
        smaller, text = partial(_smaller, obstacle.name), partial(_smaller_text, obstacle.name)
        yield Relaxation("passage", f"of the size of {obstacle.name}", 1.0, -0.05, 19, smaller, text)
    yield Relaxation("passage", "m off every side of a gripper", 0.0, 0.001, 12, _thinner, _thinner_text, whole=False)
    rougher, stronger = "with {:.2f} times the friction".format, "with {:.2f} times the motor torque".format
    yield Relaxation("equilibrium", "times the friction", 1.0, 0.05, 40, _rougher, rougher)
    yield Relaxation("torque", "times the motor torque", 1.0, 0.05, 60, partial(_stronger, folder), stronger)
    yield Relaxation("reach", "m of reach", 0.0, 0.005, 20, _further, _further_text, whole=False)


def _smaller(name: str, climb: Climb, share: float) -> Climb:
    def shrink(content: dict[str, Any]) -> None:
        for obstacle in content["obstacles"]:
            if obstacle["name"] == name:
                foot = foot_of(obstacle)
                x, y, z = (max(SIZE_M[0], share * edge) for edge in foot.size_m)
                set_foot(obstacle, replace(foot, size_m=(x, y, z)))

    scenario = edited(climb.session.scenario, shrink)
    problem = build_problem(scenario, climb.session.robot, reach=climb.problem.limb_reach)
    problem = replace(problem, boxes=climb.problem.boxes)
    session = replace(climb.session, scenario=scenario)
    return Climb(session, Oracles.of(problem, _balance(problem)))


def _smaller_text(name: str, share: float) -> str:
    return f"with {name} at {100 * share:.0f} % of its size"


def _rougher(climb: Climb, factor: float) -> Climb:
    def roughen(content: dict[str, Any]) -> None:
        for hold in content["holds"]:
            change_friction(hold, lambda each: min(MAX_FRICTION, factor * each))
        for foothold in climb.session.scenario.footholds:
            for surface in content["surfaces"]:
                if surface["name"] == foothold.surface or ("plane" in surface and not foothold.surface):
                    surface["friction"] = min(MAX_FRICTION, factor * foothold.friction)

    rough = [replace(c, friction=np.minimum(factor * c.friction, MAX_FRICTION)) for c in climb.problem.contacts]
    problem = replace(climb.problem, contacts=rough)
    session = replace(climb.session, scenario=edited(climb.session.scenario, roughen))
    return Climb(session, replace(climb.oracles, problem=problem, equilibrium=_balance(problem)))


def _stronger(folder: Path, climb: Climb, factor: float) -> Climb:
    given = climb.problem
    limits_Nm, last_Nm = factor * given.torque_limits_Nm, factor * given.last_torques_Nm
    problem = replace(given, torque_limits_Nm=limits_Nm, last_torques_Nm=last_Nm)
    robot = _with_motors(climb.session.robot, factor, folder / f"{factor:g}.urdf")
    oracles = replace(climb.oracles, problem=problem, equilibrium=_balance(problem))
    return Climb(replace(climb.session, robot=robot), oracles)


def _with_motors(robot: Robot, factor: float, path: Path) -> Robot:
    """The robot with motors of so many times the torque; for the check, its URDF is written to `path`."""

    def limb(each: Limb) -> Limb:
        return replace(each, joints=tuple(replace(joint, effort=factor * joint.effort) for joint in each.joints))

    own = robot.transmissions
    if own != Transmissions():
        own = replace(own, torque_Nm=tuple(factor * torque_Nm for torque_Nm in own.torque_Nm))
    tree = ElementTree.parse(robot.urdf_path)
    names = {name for each in robot.limbs for name in each.joint_names}
    for joint in tree.getroot().findall("joint"):
        limit = joint.find("limit")
        if joint.get("name") in names and limit is not None:
            limit.set("effort", repr(factor * float(limit.get("effort", "inf"))))
    tree.write(path)
    limbs = cast(tuple[Limb, Limb, Limb, Limb], tuple(map(limb, robot.limbs)))
    return replace(robot, limbs=limbs, urdf_path=path, transmissions=own)


def _thinner(climb: Climb, amount_m: float) -> Climb:
    swing = climb.problem.swing
    clearance_m, body_m = swing.clearance_m - amount_m, swing.body_clearance_m - 2 * amount_m
    swing = replace(swing, clearance_m=clearance_m, body_clearance_m=body_m)
    problem = replace(climb.problem, swing=swing)
    return replace(climb, oracles=replace(climb.oracles, problem=problem, swings=SwingCache(problem)))


def _thinner_text(amount_m: float) -> str:
    return f"with grippers {1000 * amount_m:.0f} mm thinner on every side"


def _further(climb: Climb, amount_m: float) -> Climb:
    boxes = climb.problem.boxes
    extent_m = boxes.extent_m + amount_m * np.hypot(*boxes.directions[:, :2].T)
    problem = replace(climb.problem, boxes=replace(boxes, extent_m=extent_m))
    reachable, balance = ReachableSet(problem), _balance(problem)
    oracles = replace(climb.oracles, problem=problem, reachable=reachable, equilibrium=balance)
    return replace(climb, oracles=oracles)


def _further_text(amount_m: float) -> str:
    return f"with {1000 * amount_m:.0f} mm more reach of a level body along and across it"


def _balance(problem: Problem) -> TorqueLimits:
    return TorqueLimits(problem, problem.friction_share)
