"""What planner and runtime stand on beyond the form of a URDF: a tree of bodies with masses, four limbs of four to
seven revolute joints, fingers that close along the gripper's x; and which limbs have closed-form kinematics.

The runtime has the same rules in the same order (runtime/core/robot/robot_rules.cpp), and names the first that is
broken; tests/cross/test_robot_verdicts.py holds both to one verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain as one_after_another
from itertools import repeat

import numpy as np

from . import robot_bounds as bounds
from .urdf import Joint, Urdf, Vector, roll_pitch_yaw, rotation, shown
from .yaml_document import Problem

MIRRORED_JOINTS = (0, 4, 5)  # yaw, roll, yaw: a mirror turns their sense around
MIN_LINK_M = 0.01
SAME_DIRECTION_RAD = 1e-4  # of mirrored limbs: URDFs round a quarter of a turn
FINGER_AXES = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))


@dataclass(frozen=True)
class Step:
    """A joint of a limb, or the gripper's mount, placed in the frame of the joint before it."""

    joint: Joint
    xyz_m: Vector
    rpy_rad: Vector
    sense: float
    """-1 where the joint turns against the axis that the closed form has."""


@dataclass(frozen=True)
class Chain:
    """A limb from the body outwards: its joints, then the gripper's mount."""

    steps: tuple[Step, ...]

    @property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(step.joint for step in self.steps[:-1])

    @property
    def gripper_link(self) -> str:
        return self.steps[-1].joint.child


class RobotRules:
    """The checks of one URDF; `problems` are what it already has, and get what the checks find.

    What a link or joint was found wrong in is not measured against others.
    """

    def __init__(self, urdf: Urdf, body_link: str, problems: list[Problem]) -> None:
        self.urdf, self.body_link, self.problems = urdf, body_link, problems

    def note(self, key: str, value: str, expected: str) -> None:
        self.problems.append(Problem(key, value, expected))

    def _is_wrong(self, *joints: Joint) -> bool:
        keys = {f"joint {joint.name}" for joint in joints}
        return any(problem.key in keys for problem in self.problems)

    def check_tree(self) -> bool:
        """Whether all links hang on the body link, each on one joint."""
        before = len(self.problems)
        if self.body_link not in self.urdf.links:
            self.note(f"link {self.body_link}", "", "no such link (body_link of robot.yaml)")
            return False
        by_child: dict[str, Joint] = {}
        for joint in self.urdf.joints.values():
            if joint.child == self.body_link:
                self.note(f"joint {joint.name}", joint.child, "expected no joint above robot.yaml's body_link")
            if joint.child in by_child:
                other = by_child[joint.child].name
                self.note(f"joint {joint.name}", joint.child, f"this link hangs on joint {other} already")
            by_child[joint.child] = joint
        if len(self.problems) > before:
            return False
        for name in self.urdf.links:
            link, steps = name, 0
            while link in by_child and steps <= len(by_child):
                link, steps = by_child[link].parent, steps + 1
            if link != self.body_link:
                self.note(f"link {name}", "", f"expected it to hang on {self.body_link}")
        return len(self.problems) == before

    def chain(self, limb: str, gripper_link: str, names: Sequence[str]) -> Chain | None:
        """The joints of a limb and the gripper's mount; None where it has other joints."""
        if gripper_link not in self.urdf.links:
            self.note(f"link {gripper_link}", "", f"no such link (gripper of limb {limb})")
            return None
        chain = self.urdf.chain(self.body_link, gripper_link)
        moving = [joint for joint in chain if joint.kind != "fixed"]
        if not moving or [joint.name for joint in moving] != list(names[: max(len(moving), bounds.LEAST_JOINTS)]):
            found = ", ".join(joint.name for joint in moving)
            fewer = f", or the first {bounds.LEAST_JOINTS} or more of them" if len(names) > bounds.LEAST_JOINTS else ""
            self.note(f"limb {limb}", found, f"expected the joints {', '.join(names)} from the body outwards{fewer}")
            return None
        if chain[-1].kind != "fixed":
            self.note(f"limb {limb}", "", f"expected {len(moving)} joints and then the fixed mount of the gripper")
            return None
        for joint in moving:
            if not self._is_wrong(joint) and joint.kind != "revolute":
                self.note(f"joint {joint.name}", joint.kind, "expected revolute")
        return Chain(tuple(_steps(chain)))

    def check_fingers(self, gripper_link: str, fingers: tuple[str, str], opening_m: tuple[float, float]) -> bool:
        """Whether they are there. Finger 1 opens along the gripper's x, finger 2 against it, as robot.yaml says."""
        there = True
        for name, axis in zip(fingers, FINGER_AXES, strict=True):
            joint = self.urdf.joints.get(name)
            key = f"joint {name}"
            if joint is None or joint.parent != gripper_link:
                self.note(key, "", f"expected a prismatic joint on {gripper_link}")
                there = False
                continue
            if joint.kind != "prismatic" or not _same(joint.axis, axis):
                self.note(key, f"{joint.kind} along {shown(joint.axis)}", f"expected prismatic along {shown(axis)}")
            if not _same((*joint.xyz_m, *joint.rpy_rad), (0.0,) * 6):
                found = f"xyz {shown(joint.xyz_m)}, rpy {shown(joint.rpy_rad)}"
                self.note(key, found, "expected 0 0 0 and 0 0 0: the opening counts from the gripper's origin")
            if joint.kind == "prismatic" and not _same((joint.lower, joint.upper), opening_m):
                low, high = opening_m
                expected = f"expected {low:g}..{high:g}, gripper.opening_m of robot.yaml"
                self.note(key, f"{joint.lower:g}..{joint.upper:g}", expected)
        return there

    def check_bodies(self, moving: Iterable[Joint], grippers: Iterable[str]) -> None:
        """What moves has a mass, and nothing else has one or moves."""
        joints = {joint.name for joint in moving}
        parts = {self.body_link, *grippers} | {self.urdf.joints[name].child for name in joints}
        for joint in self.urdf.joints.values():
            if joint.name not in joints and joint.kind != "fixed":
                self.note(f"joint {joint.name}", joint.kind, "expected fixed: no joint of a limb or finger")
        for link in self.urdf.links.values():
            key, mass = f"link {link.name}", f"mass {link.mass_kg:g}"
            if link.name not in parts and link.mass_kg > 0:
                self.note(key, mass, "expected 0: no body, limb or finger; add it to the link it is fixed to")
            if link.name in parts and 0 <= link.mass_kg < bounds.MIN_MASS_KG:
                self.note(key, mass, f"expected at least {bounds.MIN_MASS_KG:g} kg: this link moves")

    def check_sides(self, chains: Mapping[str, Chain]) -> None:
        """Each limb starts in the quadrant that its name says; chains by limb."""
        for limb, chain in chains.items():
            shoulder = chain.steps[0]
            x, y, _ = shoulder.xyz_m
            along, aside = _quadrant(limb)
            if x * along <= bounds.ALIKE or y * aside <= bounds.ALIKE:
                expected = f"expected x {_side(along)} 0 and y {_side(aside)} 0 for limb {limb}"
                self.note(f"joint {shoulder.joint.name}", f"xyz {shown(shoulder.xyz_m)}", expected)


def have_closed_form(chains: Mapping[str, Chain]) -> bool:
    """Whether all limbs have the form that closed-form kinematics needs, and are mirror images of the first."""
    first = next(iter(chains.values())).steps
    if any(len(chain.steps) != bounds.JOINTS + 1 for chain in chains.values()):
        return False
    return all(_has_closed_form(each.steps) and _mirrored(first, limb, each.steps) for limb, each in chains.items())


def _has_closed_form(steps: Sequence[Step]) -> bool:
    """Axes of JOINT_AXES or against them, links along x, a wrist in one point, the gripper on the last axis."""
    if not all(_along(step.joint.axis, axis) for step, axis in zip(steps, bounds.JOINT_AXES, strict=False)):
        return False
    for index, step in enumerate(steps):
        x, y, z = step.xyz_m
        if index in (0, bounds.JOINTS):
            on_axis = index == 0 or (_same((x, y), (0.0, 0.0)) and z <= -MIN_LINK_M)
            if not (on_axis and _same(step.rpy_rad[:2], (0.0, 0.0))):
                return False
            continue
        along_x = _same((y, z), (0.0, 0.0)) and x >= MIN_LINK_M
        if not (along_x if index in (2, 3) else _same((x, y, z), (0.0, 0.0, 0.0))):
            return False
        if not _same(step.rpy_rad, (0.0, 0.0, 0.0)):
            return False
    return True


def _mirrored(first: Sequence[Step], limb: str, steps: Sequence[Step]) -> bool:
    """Whether a limb is the first one mirrored into its quadrant."""
    along, aside = _quadrant(limb)
    for index, (one, other) in enumerate(zip(first, steps, strict=True)):
        x, y, z = one.xyz_m
        if not _same(other.xyz_m, (along * x, aside * y, z) if index == 0 else one.xyz_m):
            return False
        if index < bounds.JOINTS:
            low, high = one.joint.lower, one.joint.upper
            mirrored = along * aside < 0 and index in MIRRORED_JOINTS
            if mirrored != (one.sense * other.sense < 0):
                low, high = -high, -low
            if not _same((other.joint.lower, other.joint.upper), (low, high)):
                return False
    yaw, other_yaw = first[0].rpy_rad[2], steps[0].rpy_rad[2]
    x, y = along * math.cos(yaw), aside * math.sin(yaw)
    return math.hypot(math.cos(other_yaw) - x, math.sin(other_yaw) - y) <= SAME_DIRECTION_RAD


def _steps(chain: Sequence[Joint]) -> Iterable[Step]:
    """The joints that move, and all fixed ones behind the last of them as one; those in between move the next joint."""
    axes = one_after_another(bounds.JOINT_AXES, repeat(FINGER_AXES[0]))  # a seventh joint has no sense
    place, turn = np.zeros(3), np.eye(3)
    fixed = 0
    for index, joint in enumerate(chain):
        place, turn = place + turn @ np.array(joint.xyz_m), turn @ rotation(joint.rpy_rad)
        last = index == len(chain) - 1
        if joint.kind == "fixed" and not last:
            fixed += 1
            continue
        x, y, z, *rpy = (float(v) for v in (*place, *roll_pitch_yaw(turn)))
        own_xyz, own_rpy = ((x, y, z), (rpy[0], rpy[1], rpy[2])) if fixed else (joint.xyz_m, joint.rpy_rad)
        against = not last and sum(a * b for a, b in zip(joint.axis, next(axes), strict=True)) < 0
        yield Step(joint, own_xyz, own_rpy, -1.0 if against else 1.0)
        place, turn, fixed = np.zeros(3), np.eye(3), 0


def _quadrant(limb: str) -> tuple[float, float]:
    """Signs of x and y: front or rear, left or right."""
    return (1.0 if limb[1] == "F" else -1.0), (1.0 if limb[0] == "L" else -1.0)


def _side(sign: float) -> str:
    return "above" if sign > 0 else "below"


def _along(axis: Vector, wanted: Vector) -> bool:
    """Or against it."""
    return _same(axis, wanted) or _same([-v for v in axis], wanted)


def _same(found: Sequence[float], wanted: Sequence[float]) -> bool:
    return all(abs(a - b) <= bounds.ALIKE for a, b in zip(found, wanted, strict=True))
