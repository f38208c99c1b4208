"""What planner and runtime stand on beyond the form of a URDF: a tree of bodies with masses, four mirrored limbs of one
kind, fingers that close along the gripper's x.

The runtime has the same rules in the same order (runtime/core/robot/robot_rules.cpp), and names the first that is
broken; tests/cross/test_robot_verdicts.py holds both to one verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from . import robot_bounds as bounds
from .urdf import Joint, Urdf, Vector, roll_pitch_yaw, rotation, shown
from .yaml_document import Problem

MIRRORED_JOINTS = (0, 4, 5)  # yaw, roll, yaw: a mirror turns their sense around
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
        """The joints of a limb and the gripper's mount, of the form that the closed form needs; None where it has other
        joints."""
        if gripper_link not in self.urdf.links:
            self.note(f"link {gripper_link}", "", f"no such link (gripper of limb {limb})")
            return None
        chain = self.urdf.chain(self.body_link, gripper_link)
        moving = [joint for joint in chain if joint.kind != "fixed"]
        if [joint.name for joint in moving] != list(names):
            found = ", ".join(joint.name for joint in moving)
            self.note(f"limb {limb}", found, f"expected the joints {', '.join(names)} from the body outwards")
            return None
        if chain[-1].kind != "fixed":
            self.note(f"limb {limb}", "", f"expected {bounds.JOINTS} joints and then the fixed mount of the gripper")
            return None
        steps = tuple(_steps(chain))
        for step, axis in zip(steps, bounds.JOINT_AXES, strict=False):
            joint = step.joint
            if not self._is_wrong(joint) and (joint.kind != "revolute" or not _along(joint.axis, axis)):
                found = f"{joint.kind} about {shown(joint.axis)}"
                self.note(f"joint {joint.name}", found, f"expected revolute about {shown(axis)}, or against it")
        self._check_origins(steps)
        return Chain(steps)

    def _check_origins(self, steps: Sequence[Step]) -> None:
        """Links along x, a wrist in one point, the gripper on the last axis."""
        for index, step in enumerate(steps):
            key, xyz, rpy = f"joint {step.joint.name}", f"xyz {shown(step.xyz_m)}", f"rpy {shown(step.rpy_rad)}"
            x, y, z = step.xyz_m
            if index in (0, bounds.JOINTS):
                if not _same(step.rpy_rad[:2], (0.0, 0.0)):
                    self.note(key, rpy, "expected a turn about z only")
                if index == bounds.JOINTS and not (_same((x, y), (0.0, 0.0)) and z <= -bounds.MIN_LINK_M):
                    expected = f"expected the gripper on the last axis: 0 0 z, z at most -{bounds.MIN_LINK_M:g}"
                    self.note(key, xyz, expected)
                continue
            if index in (2, 3):
                if not _same((y, z), (0.0, 0.0)) or x < bounds.MIN_LINK_M:
                    self.note(key, xyz, f"expected a link along x: x 0 0, x at least {bounds.MIN_LINK_M:g}")
            elif not _same(step.xyz_m, (0.0, 0.0, 0.0)):
                self.note(key, xyz, "expected 0 0 0: the axes meet in one point")
            if not _same(step.rpy_rad, (0.0, 0.0, 0.0)):
                self.note(key, rpy, "expected 0 0 0")

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

    def check_mirrored(self, chains: Mapping[str, Chain]) -> None:
        """All limbs are mirror images of the first, each in the quadrant that its name says; chains by limb."""
        first = next(iter(chains.values())).steps
        wrong = {step.joint.name for chain in chains.values() for step in chain.steps if self._is_wrong(step.joint)}
        for limb, chain in chains.items():
            shoulder = chain.steps[0]
            x, y, _ = shoulder.xyz_m
            along, aside = _quadrant(limb)
            if x * along <= bounds.ALIKE or y * aside <= bounds.ALIKE:
                expected = f"expected x {_side(along)} 0 and y {_side(aside)} 0 for limb {limb}"
                self.note(f"joint {shoulder.joint.name}", f"xyz {shown(shoulder.xyz_m)}", expected)
                wrong.add(shoulder.joint.name)
            for index, (one, other) in enumerate(zip(first, chain.steps, strict=True)):
                if {one.joint.name, other.joint.name} & wrong:
                    continue
                x, y, z = one.xyz_m
                self._check_place(one, other, (along * x, aside * y, z) if index == 0 else one.xyz_m)
                if index < bounds.JOINTS:
                    self._check_limits(one, other, along * aside < 0 and index in MIRRORED_JOINTS)
            if not {first[0].joint.name, shoulder.joint.name} & wrong:
                self._check_yaw(first[0], shoulder, along, aside)

    def _check_place(self, one: Step, other: Step, wanted: Vector) -> None:
        if not _same(other.xyz_m, wanted):
            expected = f"expected {shown(wanted)}, mirrored from {one.joint.name}: all limbs are alike"
            self.note(f"joint {other.joint.name}", f"xyz {shown(other.xyz_m)}", expected)

    def _check_limits(self, one: Step, other: Step, mirrored: bool) -> None:
        low, high = one.joint.lower, one.joint.upper
        if mirrored != (one.sense * other.sense < 0):
            low, high = -high, -low
        if not _same((other.joint.lower, other.joint.upper), (low, high)):
            found = f"{other.joint.lower:g}..{other.joint.upper:g}"
            expected = f"expected {low + 0.0:g}..{high + 0.0:g}, mirrored from {one.joint.name}: all limbs are alike"
            self.note(f"joint {other.joint.name}", found, expected)

    def _check_yaw(self, one: Step, other: Step, along: float, aside: float) -> None:
        yaw = other.rpy_rad[2]
        x, y = along * math.cos(one.rpy_rad[2]), aside * math.sin(one.rpy_rad[2])
        if math.hypot(math.cos(yaw) - x, math.sin(yaw) - y) > bounds.SAME_DIRECTION_RAD:
            expected = f"expected {math.atan2(y, x):.4g}, mirrored from {one.joint.name}: all limbs are alike"
            self.note(f"joint {other.joint.name}", f"yaw {yaw:.4g}", expected)


def _steps(chain: Sequence[Joint]) -> Iterable[Step]:
    """The joints that move, and all fixed ones behind the last of them as one; those in between move the next joint."""
    axes = iter(bounds.JOINT_AXES)
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
