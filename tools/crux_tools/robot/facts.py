"""The numbers that an imported robot needs and its URDF may lack: limits, torques, speeds, masses, all at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.robot_bounds import MAX_EFFORT, MAX_SPEED
from crux_contracts.urdf import Joint
from crux_contracts.yaml_document import Problem

from crux_tools.robot.mapping import Mapping, bare
from crux_tools.robot.serial import ROUND_M, Finger, Part, SerialLimb

Interval = tuple[float, float]


@dataclass(frozen=True)
class JointFacts:
    """Of a joint [rad, Nm, rad/s] or finger [m, N, m/s]."""

    limits: Interval
    effort: float
    speed: float


class Facts:
    """What the mapping says, else the URDF. What neither has is noted, once for all limbs."""

    def __init__(self, mapping: Mapping, problems: list[Problem]) -> None:
        self.mapping, self.problems = mapping, problems
        self._missing: dict[tuple[str, str], dict[str, None]] = {}

    def missing(self, key: str, what: str, name: str = "") -> None:
        """Of the joint with this name."""
        self._missing.setdefault((key, what), {})[name] = None

    def tell(self) -> None:
        """Adds what is missing to the problems, of all joints in one."""
        for (key, what), names in self._missing.items():
            self.problems.append(Problem(key, ", ".join(filter(None, names)), f"is missing: {what}"))

    def joint(self, pattern: str, joint: Joint) -> JointFacts:
        """Of a joint of a limb, by its name with {}."""
        name, mapping, limits = bare(pattern), self.mapping, self.limits(pattern, joint)
        effort = self._value(mapping.effort_Nm, name, (joint.effort, MAX_EFFORT), "effort_Nm", "peak torque")
        speed = self._value(mapping.speed_rad_s, name, (joint.velocity, MAX_SPEED), "speed_rad_s", "greatest speed")
        return JointFacts(limits, effort, speed)

    def limits(self, pattern: str, joint: Joint) -> Interval:
        """Of the same."""
        name, given = bare(pattern), self.mapping.limits_rad
        limits = (given[name][0], given[name][1]) if name in given else (joint.lower, joint.upper)
        if not np.isfinite(limits).all() or not limits[0] < limits[1]:
            self.missing("limits_rad", "[low, high] of each; the URDF has none", name)
        return limits

    def _value(self, given: dict[str, float], name: str, own: tuple[float, float], key: str, what: str) -> float:
        """`own` is the URDF's, and the most that a motor may have: more says nothing of the motor."""
        value = given.get(name, own[0] if 0 < own[0] <= own[1] else given.get("default", 0.0))
        if not value > 0:
            self.missing(key, f"{what} of each, or default; the URDF has none within 0..{own[1]:g}", name)
        return float(value)

    def finger(self, fingers: list[Finger]) -> JointFacts:
        """Of both fingers of a limb, which have to agree."""
        given = self.mapping.finger
        travels = [travel_m(finger, sign) for finger, sign in zip(fingers, (1.0, -1.0), strict=True)]
        limits = tuple(given.get("opening_m", travels[0]))
        if "opening_m" not in given and not (np.allclose(travels[0], travels[1], atol=1e-5) and travels[0][0] > 0):
            shown = " and ".join(f"{low:g}..{high:g}" for low, high in travels)
            self.missing("finger.opening_m", f"[low, high] of each pad off the middle; the fingers slide {shown} m")
        found = []
        for key, what, own in (
            ("effort_N", "greatest force", min(finger.joint.effort for finger in fingers)),
            ("speed_m_s", "greatest speed", min(finger.joint.velocity for finger in fingers)),
        ):
            value = float(given.get(key, own))
            if not value > 0:
                self.missing(f"finger.{key}", f"{what} of a finger; the URDF has none above 0")
            found.append(value)
        return JointFacts((limits[0], limits[1]), *found)

    def scale_masses(self, body: Part, limbs: list[SerialLimb]) -> None:
        """To those of the mapping."""
        parts = [part for limb in limbs for part in (*limb.parts, *(finger.part for finger in limb.fingers))]
        rest = sum(part.mass_kg for part in parts)
        wanted_body = self.mapping.masses_kg.get("body", body.mass_kg)
        total = self.mapping.masses_kg.get("total")
        if not rest > 0 or not body.mass_kg > 0:
            self.missing("masses_kg", "the URDF has no masses, and inertias cannot be made up")
            return
        if total is None:
            body.scale(wanted_body / body.mass_kg)
            return
        if "body" not in self.mapping.masses_kg:
            wanted_body = total * body.mass_kg / (body.mass_kg + rest)
        if not 0 < wanted_body < total:
            self.problems.append(Problem("masses_kg.body", f"{wanted_body:g}", f"expected 0..{total:g}"))
            return
        body.scale(wanted_body / body.mass_kg)
        for part in parts:
            part.scale((total - wanted_body) / rest)


def travel_m(finger: Finger, sign: float) -> Interval:
    """How far the finger's frame is off the middle, along +x of the gripper for finger 1 and -x for finger 2."""
    sense = 1.0 if finger.axis[0] > 0 else -1.0
    ends = [sign * (finger.start_m[0] + sense * at) for at in (finger.joint.lower, finger.joint.upper)]
    return round(min(ends), ROUND_M) + 0.0, round(max(ends), ROUND_M) + 0.0  # no -0
