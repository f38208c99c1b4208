"""What the blocks must agree on: eta = [x; u] at the knots, its copy delta and the scaled dual epsilon of (17).

x: body state, finger positions and gripper yaws; u: finger forces and moments in H. y is not in the consensus, of z
who is in the air, in P3 alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.limit_surface import finger_forces

FINGERS = 8
POSITION_THRESHOLD_M, FORCE_THRESHOLD_N = 0.03, 0.5  # the paper's, here on the largest residual of all


@dataclass(frozen=True)
class Scales:
    """Units of the consensus norm: a residual counts by its share of these."""

    position: float = 1.0  # [1/m]
    orientation: float = 1.0  # [1/rad]
    rate: float = 0.1  # on velocities [s/m], [s/rad]
    force: float = 0.01  # [1/N]
    moment: float = 0.75  # [1/Nm]: a force of 0.01 at a patch's radius of twist
    flag: float = 1.0  # on who is away in a window, of P3


@dataclass(frozen=True)
class Eta:
    """eta, delta or epsilon: body (N + 1, 12), fingers (N + 1, 8, 3), yaws (N + 1, 4), forces, moments (N, 8, 3).

    Point feet are four, with yaws and moments left out: (N + 1, 0) and (N, 0, 3). `away` (T, 4) of P3 alone: 1 where a
    limb is in the air in a window.
    """

    body: Array
    fingers: Array
    yaws: Array
    forces: Array
    moments: Array
    away: Array = field(default_factory=lambda: np.zeros((0, 4)))

    def __add__(self, other: Eta) -> Eta:
        return self._with(other, np.add)

    def __sub__(self, other: Eta) -> Eta:
        return self._with(other, np.subtract)

    def times(self, factor: float) -> Eta:
        """Every number times `factor`."""
        return Eta(*(factor * getattr(self, f.name) for f in fields(self)))

    def _with(self, other: Eta, how: Callable[[Array, Array], Array]) -> Eta:
        return Eta(*(how(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))

    @classmethod
    def zeros(cls, steps: int) -> Eta:
        """All zero, for N = `steps`."""
        shapes = ((steps + 1, 12), (steps + 1, FINGERS, 3), (steps + 1, 4), (steps, FINGERS, 3), (steps, FINGERS, 3))
        return cls(*(np.zeros(shape) for shape in shapes))

    @classmethod
    def of_contacts(cls, problem: Problem, schedule: Schedule, body: Array, wrenches: list[dict[int, Array]]) -> Eta:
        """eta of a contact block: poses of a schedule, q = (s1, s2, m, n1, n2) per knot and limb in stance."""
        forces = np.zeros((problem.steps, FINGERS, 3))
        moments = np.zeros((problem.steps, FINGERS, 3))
        for k, knot in enumerate(wrenches):
            for limb, q in knot.items():
                contact = problem.contacts[schedule.contacts[k][limb] or 0]
                place = slice(2 * limb, 2 * limb + 2)
                forces[k, place], moments[k, place] = finger_forces(q, contact.axis, contact.tangent)
        return cls(body, finger_positions(schedule.poses), schedule.poses[..., 3], forces, moments)

    @classmethod
    def of_points(cls, body: Array, feet: Array, forces: Array) -> Eta:
        """eta of point feet (N + 1, 4, 3) and forces (N, 4, 3): these have neither yaws nor moments."""
        return cls(body, feet, np.zeros((len(body), 0)), forces, np.zeros((len(forces), 0, 3)))


def finger_positions(poses: Array) -> Array:
    """(..., 2 L, 3) pads of grippers at poses (..., L, 5): equation (9b), finger 1 at +e."""
    axis = np.stack([np.cos(poses[..., 3]), np.sin(poses[..., 3]), np.zeros(poses.shape[:-1])], axis=-1)
    half = poses[..., 4:5] * axis
    both = np.stack([poses[..., :3] + half, poses[..., :3] - half], axis=-2)
    return both.reshape(*poses.shape[:-2], -1, 3)


@dataclass(frozen=True)
class Residuals:
    """eta - delta of one iteration: largest and root mean square, each of a vector's components by itself."""

    position_m: float
    orientation_rad: float
    force_N: float
    moment_Nm: float
    position_rms_m: float
    orientation_rms_rad: float
    force_rms_N: float
    moment_rms_Nm: float
    out_of_turn: int = field(default=0, kw_only=True)  # windows in which P3's limbs do not do as their copy has it

    @classmethod
    def of(cls, difference: Eta, *, body: bool = True) -> Residuals:
        """Of eta - delta; positions are the body's and the fingers', without `body` (one block alone has it) theirs."""
        shared = difference.body if body else difference.body[:0]
        groups = (
            np.concatenate([shared[:, 0:3].ravel(), difference.fingers.ravel()]),
            np.concatenate([shared[:, 3:6].ravel(), difference.yaws.ravel()]),
            difference.forces.ravel(),
            difference.moments.ravel(),
        )
        largest = [float(np.abs(group).max(initial=0.0)) for group in groups]
        return cls(*largest, *[float(np.sqrt(np.mean(group**2))) if group.size else 0.0 for group in groups])

    @property
    def converged(self) -> bool:
        """The paper's thresholds, in the maximum norm; of P3's limbs none is out of turn."""
        return not self.out_of_turn and self.position_m <= POSITION_THRESHOLD_M and self.force_N <= FORCE_THRESHOLD_N

    def line(self, iteration: int) -> str:
        """One line for people."""
        return (
            f"iteration {iteration}: residuals (largest, rms) position {1000 * self.position_m:.2f}, "
            f"{1000 * self.position_rms_m:.2f} mm; orientation {self.orientation_rad:.4f}, "
            f"{self.orientation_rms_rad:.4f} rad; force {self.force_N:.3f}, {self.force_rms_N:.3f} N; "
            f"moment {self.moment_Nm:.4f}, {self.moment_rms_Nm:.4f} Nm"
        )
