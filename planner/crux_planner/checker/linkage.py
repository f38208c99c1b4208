"""A five-bar between two joints and what turns them, by circles and levers: section `five_bar` of robot.yaml.

All points are in the plane of the linkage, seen along the first joint's axis, with that axis at the origin.
"""

from dataclasses import dataclass

import numpy as np
from crux_msgs.robot_keys import FiveBar

from crux_planner.checker.geometry import Array


@dataclass(frozen=True, eq=False)
class Linkage:
    """Of joints number `first` (from 0) and the next, `apart_m` from each other, the next turning by `sense` in the
    first's direction. Both have `middle_rad` (2,) in the middle of their ranges, where the linkage closes.
    """

    bar: FiveBar
    first: int
    apart_m: float
    sense: float
    middle_rad: Array

    def crank_rad(self, q_rad: Array) -> Array:
        """(T,) for joints at (T, 2): within half a turn of the middle's; NaN where the rod does not reach."""
        way, middle = self._crank(q_rad), self._crank(self.middle_rad[None])
        across = middle[:, 0] * way[:, 1] - middle[:, 1] * way[:, 0]
        return np.asarray(np.arctan2(middle[:, 1], middle[:, 0]) + np.arctan2(across, (middle * way).sum(axis=1)))

    def sine(self, q_rad: Array) -> Array:
        """(T,) of the angle between rod and crank or pin's lever, whichever is less; negative in the other branch
        of the latter, NaN where the rod does not reach.
        """
        crank, (_, pin, rod) = self._crank(q_rad), self._levers(q_rad)
        at_middle = _lever(*self._levers(self.middle_rad[None])[1:])
        at_crank = np.abs(_lever(crank, rod)) / self.bar.crank_m
        at_pin = np.sign(at_middle) * _lever(pin, rod) / np.hypot(self.bar.pin_x_m, self.bar.pin_y_m)
        return np.asarray(np.minimum(at_crank, at_pin))

    def torques_Nm(self, q_rad: Array, joints_Nm: Array) -> Array:
        """(T, 2) of the first actuator and the crank, for the joints' (T, 2): the rod pushes with a force that gives
        the next joint its torque, turns the crank against its actuator, and relieves the first actuator.
        """
        whole, pin, rod = self._levers(q_rad)
        push_N = self.sense * joints_Nm[:, 1] / _lever(pin, rod)
        crank_Nm = push_N * _lever(self._crank(q_rad), rod)
        return np.stack([joints_Nm[:, 0] - push_N * _lever(whole, rod), crank_Nm], axis=1)

    def _levers(self, q_rad: Array) -> tuple[Array, Array, Array]:
        """(T, 2) each: the pin from the first joint's axis and from the next's, and the rod's direction."""
        pin = _turned(np.array([[self.bar.pin_x_m, self.bar.pin_y_m]]), q_rad[:, 0] + self.sense * q_rad[:, 1])
        whole = pin + _turned(np.array([[self.apart_m, 0.0]]), q_rad[:, 0])
        return whole, pin, (whole - self._axis - self._crank(q_rad)) / self.bar.rod_m

    @property
    def _axis(self) -> Array:
        return np.array([self.bar.crank_x_m, self.bar.crank_y_m])

    def _crank(self, q_rad: Array) -> Array:
        """(T, 2): its end is where the circles of crank and rod meet, on the side that `bends` says."""
        pin = _turned(np.array([[self.bar.pin_x_m, self.bar.pin_y_m]]), q_rad[:, 0] + self.sense * q_rad[:, 1])
        line = pin + _turned(np.array([[self.apart_m, 0.0]]), q_rad[:, 0]) - self._axis
        square = (line**2).sum(axis=1)
        along = (square + self.bar.crank_m**2 - self.bar.rod_m**2) / (2.0 * square)
        with np.errstate(invalid="ignore"):
            aside = self.bar.bends * np.sqrt(self.bar.crank_m**2 / square - along**2)
        return np.asarray(along[:, None] * line + aside[:, None] * np.stack([-line[:, 1], line[:, 0]], axis=1))


def read_linkage(bar: FiveBar | None, origins_m: Array, axes: Array, range_rad: tuple[Array, Array]) -> Linkage | None:
    """Of a limb with joints at these places (J, 3) about these axes (J, 3), with all angles 0, of which `range_rad` has
    the lower and upper limits (J,). Raises ValueError where the two joints do not turn in one plane.
    """
    if bar is None or bar.first_joint == 0:
        return None
    i = int(bar.first_joint) - 1
    if i + 1 >= len(axes):
        raise ValueError(f"five_bar.first_joint: no joint {i + 2} of {len(axes)}")
    cosine, way = float(axes[i] @ axes[i + 1]), np.cross(axes[i], origins_m[i + 1] - origins_m[i])
    if abs(abs(cosine) - 1.0) > _PARALLEL or not way.any():
        raise ValueError("five_bar.first_joint: the axes of both joints are not parallel, or the same")
    low, high = (limit[i : i + 2] for limit in range_rad)
    return Linkage(bar, i, float(np.linalg.norm(way)), np.sign(cosine), (low + high) / 2)


_PARALLEL = 1e-9  # of a cosine


def _turned(vector: Array, angle_rad: Array) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([c * vector[:, 0] - s * vector[:, 1], s * vector[:, 0] + c * vector[:, 1]], axis=1)


def _lever(arm: Array, force: Array) -> Array:
    """(T,) moment of a force (T, 2) at an arm (T, 2)."""
    return np.asarray(arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])
