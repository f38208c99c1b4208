"""What planner and runtime stand on beyond the form of a URDF: a tree of bodies with masses, four mirrored limbs of one
kind, fingers that close along the gripper's x.

The runtime has the same rules in the same order (runtime/core/robot/robot_rules.cpp);
tests/cross/test_robot_verdicts.py holds both to one verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from . import robot_bounds as bounds
from .urdf import Joint, Urdf, UrdfError, Vector, shown
from .yaml_document import Problem

MIRRORED_JOINTS = (0, 4, 5)  # yaw, roll, yaw: a mirror turns their sense around
FINGER_AXES = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))


class RobotRules:
    """The checks of one URDF. Every one raises UrdfError."""

    def __init__(self, urdf: Urdf, path: str, body_link: str) -> None:
        self.urdf, self.path, self.body_link = urdf, path, body_link

    def fail(self, key: str, value: str, expected: str) -> UrdfError:
        return UrdfError(self.path, [Problem(key, value, expected)])

    def check_tree(self) -> None:
        """All links hang on the body link, each on one joint."""
        if self.body_link not in self.urdf.links:
            raise self.fail(f"link {self.body_link}", "", "no such link (body_link of robot.yaml)")
        by_child: dict[str, Joint] = {}
        for joint in self.urdf.joints.values():
            if joint.child == self.body_link:
                raise self.fail(f"joint {joint.name}", joint.child, "expected no joint above robot.yaml's body_link")
            if joint.child in by_child:
                other = by_child[joint.child].name
                raise self.fail(f"joint {joint.name}", joint.child, f"this link hangs on joint {other} already")
            by_child[joint.child] = joint
        for name in self.urdf.links:
            link, steps = name, 0
            while link in by_child and steps <= len(by_child):
                link, steps = by_child[link].parent, steps + 1
            if link != self.body_link:
                raise self.fail(f"link {name}", "", f"expected it to hang on {self.body_link}")

    def chain(self, limb: str, gripper_link: str, names: Sequence[str]) -> list[Joint]:
        """The six joints of a limb and the gripper's mount, of the form that the closed form needs."""
        if gripper_link not in self.urdf.links:
            raise self.fail(f"link {gripper_link}", "", f"no such link (gripper of limb {limb})")
        chain = self.urdf.chain(self.body_link, gripper_link)
        moving = [joint for joint in chain if joint.kind != "fixed"]
        if [joint.name for joint in moving] != list(names):
            found = ", ".join(joint.name for joint in moving)
            raise self.fail(f"limb {limb}", found, f"expected the joints {', '.join(names)} from the body outwards")
        if len(chain) != bounds.JOINTS + 1 or chain[-1].kind != "fixed":
            raise self.fail(
                f"limb {limb}", "", f"expected {bounds.JOINTS} joints and then the fixed mount of the gripper"
            )
        for joint, axis in zip(moving, bounds.JOINT_AXES, strict=True):
            if joint.kind != "revolute" or not _same(joint.axis, axis):
                found = f"{joint.kind} about {shown(joint.axis)}"
                raise self.fail(f"joint {joint.name}", found, f"expected revolute about {shown(axis)}")
        self._check_origins(chain)
        return chain

    def _check_origins(self, chain: list[Joint]) -> None:
        """Links along x, a wrist in one point, the gripper on the last axis."""
        for index, joint in enumerate(chain):
            key, xyz, rpy = f"joint {joint.name}", f"xyz {shown(joint.xyz_m)}", f"rpy {shown(joint.rpy_rad)}"
            x, y, z = joint.xyz_m
            if index in (0, bounds.JOINTS):
                if not _same(joint.rpy_rad[:2], (0.0, 0.0)):
                    raise self.fail(key, rpy, "expected a turn about z only")
                if index == bounds.JOINTS and not (_same((x, y), (0.0, 0.0)) and z <= -bounds.MIN_LINK_M):
                    expected = f"expected the gripper on the last axis: 0 0 z, z at most -{bounds.MIN_LINK_M:g}"
                    raise self.fail(key, xyz, expected)
                continue
            if index in (2, 3):
                if not _same((y, z), (0.0, 0.0)) or x < bounds.MIN_LINK_M:
                    raise self.fail(key, xyz, f"expected a link along x: x 0 0, x at least {bounds.MIN_LINK_M:g}")
            elif not _same(joint.xyz_m, (0.0, 0.0, 0.0)):
                raise self.fail(key, xyz, "expected 0 0 0: the axes meet in one point")
            if not _same(joint.rpy_rad, (0.0, 0.0, 0.0)):
                raise self.fail(key, rpy, "expected 0 0 0")

    def check_fingers(self, gripper_link: str, fingers: tuple[str, str], opening_m: tuple[float, float]) -> None:
        """Finger 1 opens along the gripper's x, finger 2 against it, both as far as robot.yaml says."""
        for name, axis in zip(fingers, FINGER_AXES, strict=True):
            joint = self.urdf.joints.get(name)
            key = f"joint {name}"
            if joint is None or joint.parent != gripper_link:
                raise self.fail(key, "", f"expected a prismatic joint on {gripper_link}")
            if joint.kind != "prismatic" or not _same(joint.axis, axis):
                found = f"{joint.kind} along {shown(joint.axis)}"
                raise self.fail(key, found, f"expected prismatic along {shown(axis)}")
            if not _same((*joint.xyz_m, *joint.rpy_rad), (0.0,) * 6):
                found = f"xyz {shown(joint.xyz_m)}, rpy {shown(joint.rpy_rad)}"
                raise self.fail(key, found, "expected 0 0 0 and 0 0 0: the opening counts from the gripper's origin")
            if not _same((joint.lower, joint.upper), opening_m):
                low, high = opening_m
                expected = f"expected {low:g}..{high:g}, gripper.opening_m of robot.yaml"
                raise self.fail(key, f"{joint.lower:g}..{joint.upper:g}", expected)

    def check_bodies(self, moving: Iterable[Joint]) -> None:
        """What moves has a mass, and nothing else has one or moves."""
        joints = {joint.name for joint in moving}
        parts = {self.body_link} | {self.urdf.joints[name].child for name in joints}
        for joint in self.urdf.joints.values():
            if joint.name not in joints and joint.kind != "fixed":
                raise self.fail(f"joint {joint.name}", joint.kind, "expected fixed: no joint of a limb or finger")
        for link in self.urdf.links.values():
            key, mass = f"link {link.name}", f"mass {link.mass_kg:g}"
            if link.name not in parts and link.mass_kg > 0:
                raise self.fail(key, mass, "expected 0: no body, limb or finger; add it to the link it is fixed to")
            if link.name in parts and link.mass_kg < bounds.MIN_MASS_KG:
                raise self.fail(key, mass, f"expected at least {bounds.MIN_MASS_KG:g} kg: this link moves")

    def check_mirrored(self, chains: Mapping[str, Sequence[Joint]]) -> None:
        """All limbs are mirror images of the first, each in the quadrant that its name says; chains by limb."""
        first = next(iter(chains.values()))
        for limb, chain in chains.items():
            x, y, _ = chain[0].xyz_m
            along, aside = _quadrant(limb)
            if x * along <= bounds.ALIKE or y * aside <= bounds.ALIKE:
                expected = f"expected x {_side(along)} 0 and y {_side(aside)} 0 for limb {limb}"
                raise self.fail(f"joint {chain[0].name}", f"xyz {shown(chain[0].xyz_m)}", expected)
            for index, (one, other) in enumerate(zip(first, chain, strict=True)):
                x, y, z = one.xyz_m
                self._check_place(one, other, (along * x, aside * y, z) if index == 0 else one.xyz_m)
                if index < bounds.JOINTS:
                    self._check_limits(one, other, along * aside < 0 and index in MIRRORED_JOINTS)
            self._check_yaw(first[0], chain[0], along, aside)

    def _check_place(self, one: Joint, other: Joint, wanted: Vector) -> None:
        if not _same(other.xyz_m, wanted):
            expected = f"expected {shown(wanted)}, mirrored from {one.name}: all limbs are alike"
            raise self.fail(f"joint {other.name}", f"xyz {shown(other.xyz_m)}", expected)

    def _check_limits(self, one: Joint, other: Joint, mirrored: bool) -> None:
        low, high = (-one.upper, -one.lower) if mirrored else (one.lower, one.upper)
        if not _same((other.lower, other.upper), (low, high)):
            expected = f"expected {low:g}..{high:g}, mirrored from {one.name}: all limbs are alike"
            raise self.fail(f"joint {other.name}", f"{other.lower:g}..{other.upper:g}", expected)

    def _check_yaw(self, one: Joint, other: Joint, along: float, aside: float) -> None:
        yaw = other.rpy_rad[2]
        x, y = along * math.cos(one.rpy_rad[2]), aside * math.sin(one.rpy_rad[2])
        if math.hypot(math.cos(yaw) - x, math.sin(yaw) - y) > bounds.SAME_DIRECTION_RAD:
            expected = f"expected {math.atan2(y, x):.4g}, mirrored from {one.name}: all limbs are alike"
            raise self.fail(f"joint {other.name}", f"yaw {yaw:.4g}", expected)


def _quadrant(limb: str) -> tuple[float, float]:
    """Signs of x and y: front or rear, left or right."""
    return (1.0 if limb[1] == "F" else -1.0), (1.0 if limb[0] == "L" else -1.0)


def _side(sign: float) -> str:
    return "above" if sign > 0 else "below"


def _same(found: Sequence[float], wanted: Sequence[float]) -> bool:
    return all(abs(a - b) <= bounds.ALIKE for a, b in zip(found, wanted, strict=True))
