"""A five-bar in a maker's URDF, as robot.yaml has it: the open chain of crank and rod closes with all joints at 0."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from crux_contracts.five_bar import geometry
from crux_contracts.robot_bounds import MAX_EFFORT, MAX_SPEED
from numpy.typing import NDArray

from crux_tools.robot.facts import Facts, JointFacts
from crux_tools.robot.serial import ROUND_M, Reader, SerialLimb

Array = NDArray[np.float64]
ALIKE_M = 1e-4  # of the same linkage on all limbs
LEAST_SINE = 0.2


@dataclass(frozen=True)
class Linkage:
    """`points_m` (3, 2) are the crank's axis, its end and the rod's end in the plane of the linkage with all joints at
    zero; the first joint's axis is at the origin, the next's at (`link_m`, 0). The crank's joint turns by `sense` in
    the first's direction.
    """

    first: int
    points_m: Array
    link_m: float
    sense: float
    least_sine: float

    @property
    def _crank_m(self) -> Array:
        return np.asarray(self.points_m[1] - self.points_m[0])

    @property
    def _arm_m(self) -> Array:
        return np.asarray(self.points_m[2] - [self.link_m, 0.0])

    def keys(self, facts: list[JointFacts]) -> dict[str, float | list[float]]:
        """Of robot.yaml; `facts` are those of the limb's actuators, the crank's in the place of the next joint."""
        crank, rod = self._crank_m, self.points_m[2] - self.points_m[1]
        to_pin = self.points_m[2] - self.points_m[0]
        bends = math.copysign(1.0, to_pin[0] * crank[1] - to_pin[1] * crank[0])
        lengths = {"crank_x_m": self.points_m[0, 0], "crank_y_m": self.points_m[0, 1], "crank_m": np.hypot(*crank),
                   "rod_m": np.hypot(*rod), "pin_x_m": self._arm_m[0], "pin_y_m": self._arm_m[1]}  # fmt: skip
        at, turn = np.arange(len(facts)) == self.first + 1, self.sense * math.atan2(crank[1], crank[0])
        bar = {"first_joint": self.first + 1, "bends": int(bends), "least_sine": self.least_sine}
        bar |= {name: round(float(length), ROUND_M) + 0.0 for name, length in lengths.items()}
        behind = {
            "ratio": np.where(at, self.sense, 1.0).tolist(),
            "offset_rad": np.where(at, round(-turn, ROUND_M), 0.0).tolist(),
            "low_rad": [each.limits[0] for each in facts],
            "high_rad": [each.limits[1] for each in facts],
            "speed_rad_s": [each.speed for each in facts],
            "torque_Nm": [each.effort for each in facts],
        }
        return {f"five_bar.{k}": v for k, v in bar.items()} | {f"transmissions.{k}": v for k, v in behind.items()}

    def joints(self, first: JointFacts, crank: JointFacts, low_high: tuple[float, float]) -> list[JointFacts]:
        """Of both joints: more than the actuators can do wherever the linkage may be; the next has its own limits."""
        crank_m, arm_m = float(np.hypot(*self._crank_m)), float(np.hypot(*self._arm_m))
        pull_N = crank.effort / (crank_m * self.least_sine)
        slowest_m_s = crank.speed * crank_m + first.speed * (self.link_m + arm_m)
        most = first.effort + pull_N * (self.link_m + arm_m)
        return [
            JointFacts(first.limits, min(math.ceil(most), MAX_EFFORT), first.speed),
            JointFacts(
                low_high,
                min(math.ceil(pull_N * arm_m), MAX_EFFORT),
                min(math.ceil(slowest_m_s / (arm_m * self.least_sine)), MAX_SPEED),
            ),
        ]


def read_linkage(reader: Reader, limbs: list[SerialLimb]) -> Linkage | None:
    """The one that all limbs have; None where the mapping names none, or where it is none: the reader notes that."""
    if not reader.mapping.five_bar or not limbs:
        return None
    found = [_of_limb(reader, limb) for limb in limbs]
    linkages = [each for each in found if each is not None]
    if len(linkages) < len(found):
        return None
    for limb, other in zip(limbs, linkages, strict=True):
        off = float(np.abs(other.points_m - linkages[0].points_m).max())
        if off > ALIKE_M or other.sense != linkages[0].sense:
            reader.note("five_bar", limb.name, f"expected {limbs[0].name}'s: {1000 * off:.2f} mm off")
            return None
    return linkages[0]


def _of_limb(reader: Reader, limb: SerialLimb) -> Linkage | None:
    mapping, bar = reader.mapping, reader.mapping.five_bar
    names = {key: mapping.of(str(bar[key]), limb.name) for key in ("crank", "rod", "pin")}
    links = {"pin": names["pin"]}
    for key in ("crank", "rod"):
        joint = reader.urdf.joints.get(names[key])
        if joint is not None:
            links[key] = joint.child
    for key, name in names.items():
        if links.get(key) not in reader.poses:
            what = "link of the next joint" if key == "pin" else "joint before the first joint"
            reader.note(f"five_bar.{key}", name, f"expected a {what} on limb {limb.name}")
            return None
    first = mapping.joints.index(bar["first"])
    axis, pair = limb.axes[first], slice(first, first + 2)
    crank = reader.urdf.joints[names["crank"]]
    crank_axis = reader.poses[crank.child].turn @ np.array(crank.axis)
    plane = geometry(limb.axes[pair].round(3), limb.points[pair]) if first + 1 < len(limb.axes) else None
    if plane is None or abs(abs(crank_axis @ axis) - 1.0) > ALIKE_M:
        reader.note("five_bar.first", str(bar["first"]), "expected it, the next and the crank about parallel axes")
        return None
    away = limb.points[first + 1] - limb.points[first]
    x = (away - (away @ axis) * axis) / plane[0]
    places = np.array([reader.poses[links[key]].place for key in ("crank", "rod", "pin")]) - limb.points[first]
    points = np.stack([places @ x, places @ np.cross(axis, x)], axis=1)
    least_sine = float(bar.get("least_sine", LEAST_SINE))
    return Linkage(first, points, plane[0], math.copysign(1.0, float(crank_axis @ axis)), least_sine)


def joint_facts(
    linkage: Linkage | None, reader: Reader, facts: Facts, limb: SerialLimb
) -> tuple[list[JointFacts], dict[str, float | list[float]]]:
    """Of a limb's joints, and what robot.yaml says of the linkage between them and the actuators."""
    mapping = facts.mapping
    named = list(zip(mapping.joints, limb.joints, strict=True))
    if linkage is None:
        return [facts.joint(name, joint) for name, joint in named], {}
    after, pattern = linkage.first + 1, str(mapping.five_bar["crank"])
    limits = facts.limits(*named[after])
    named[after] = pattern, reader.urdf.joints[mapping.of(pattern, limb.name)]
    actuators = [facts.joint(name, joint) for name, joint in named]
    pair = linkage.joints(actuators[after - 1], actuators[after], limits)
    joints = [*actuators[: after - 1], *pair, *actuators[after + 1 :]]
    return joints, linkage.keys(actuators)
