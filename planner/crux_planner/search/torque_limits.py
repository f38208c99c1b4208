"""Balance that the motors can hold: the oracle of the search, with joint torques.

For a level body at a given place the torques of a limb are linear in its gripper's wrench. Where the wrenches found
first ask too much of a motor, a QP with torque rows looks for others, and for a better place of the body beside.
`position` knows which limb is on a contact from where it is: of two on one side of the body, the front limb is on the
front one; one with its side to itself is a front limb's where it is ahead of the body.
"""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Contacts
from crux_planner.physics.torque import joint_torques
from crux_planner.search.equilibrium import WRENCH, Query, StaticEquilibrium, clipped
from crux_planner.solvers.mapped import Mapped

SLACK = 1.1  # of the NLP's limits: its body may tilt
_ROUNDS = 3  # of linearising torques about where the body came to be
_GRIP = 18  # numbers of a grip: place, centre, axis, tangent, gravity, up
_MOVED_M = 0.005  # torques are taken as exact so near to where they were linearised


class TorqueLimits(StaticEquilibrium):
    """Balance queries answered by wrenches that no motor is too weak for."""

    def __init__(self, problem: Problem, margin: float, limits_Nm: Array | None = None) -> None:
        """`limits_Nm` (4, S): joint torques allowed, usually those of the problem with some slack."""
        super().__init__(problem, margin)
        self.limits_Nm = SLACK * problem.torque_limits_Nm if limits_Nm is None else limits_Nm
        self.gravity_h = problem.gravity_h
        self._quadrant = np.sign(problem.boxes.centre_b_m[:, :2])
        self._strong: dict[tuple[Any, ...], Array | None] = {}

    def turned(self, problem: Problem) -> TorqueLimits:
        """The same for `problem`, which is this one's in turned axes: limbs and motors are the same."""
        other = copy.copy(self)
        StaticEquilibrium.__init__(other, problem, self.margin)
        other.gravity_h, other._strong = problem.gravity_h, {}
        return other

    def within(self, limits_Nm: Array) -> TorqueLimits:
        """The same for other motors: joint torques allowed (4, S)."""
        other = copy.copy(self)
        other.limits_Nm, other._strong = limits_Nm, {}
        return other

    def by_friction(
        self, support: tuple[int, ...], low: Array, high: Array, wanted: Array, grippers: tuple[int, ...] | None = None
    ) -> Array | None:
        """As `position`, however strong the motors would have to be: much quicker."""
        return super()._find(Query(tuple(sorted(self.bearing(support))), low, high, wanted, grippers or support))

    def hold(self, held: Contacts, place: Array, grippers: tuple[int, ...]) -> bool:
        """Whether limbs on these contacts, None in the air, hold a level body at a place; each limb is known."""
        bears = [c is not None and self.problem.contacts[c].bears for c in held]
        limbs = sorted((c, limb) for limb, c in enumerate(held) if c is not None and bears[limb])
        support, on = tuple(c for c, _ in limbs), tuple(limb for _, limb in limbs)
        query = Query(support, place, place, place, grippers)
        if super()._find(query) is None:
            return False
        if self._least_norm_is_light(support, place, grippers, on):
            return True
        return self._solve_within(query, place, on) is not None

    def _find(self, query: Query) -> Array | None:
        if (key := query.key) not in self._strong:
            self._strong[key] = self._held(query)
        return self._strong[key]

    def _held(self, query: Query) -> Array | None:
        support, low, high, wanted, grippers = query
        place = super()._find(query)
        if place is None or self._least_norm_is_light(support, place, grippers):
            return place
        between = self.mean_place(support)  # the weight is shared best there
        for start, near in ((place, wanted), ((low[:3] + high[:3]) / 2, wanted), (between, between)):
            place = clipped(start, low, high)
            for _ in range(_ROUNDS):
                found = self._solve_within(query._replace(wanted=near), place)
                if found is None:
                    break
                moved, place = float(np.abs(found - place).max()), found
                if moved < _MOVED_M:
                    return place
        return None

    def _least_norm_is_light(
        self, support: tuple[int, ...], place: Array, grippers: tuple[int, ...], limbs: tuple[int, ...] | None = None
    ) -> bool:
        """Whether the wrenches of least norm are within the limit surface and the torques."""
        if not self._least_norm_fits(support, place, grippers):
            return False
        wrench = (self.least_norm(support) @ self.right_side(place, self.mean_place(grippers))).reshape(-1, 4)
        for (rows, still, limit), w in zip(self._torques(support, place, limbs), wrench, strict=True):
            if (np.abs(rows @ w + still) > limit).any():
                return False
        return True

    def _torques(
        self, support: tuple[int, ...], place: Array, limbs: tuple[int, ...] | None = None
    ) -> list[tuple[Array, Array, Array]]:
        """(A, b, limit) of every gripper: joint torques A @ (s1, s2, m, F) + b of its limb."""
        given, limits = [], []
        contacts = [self.problem.contacts[index] for index in support]
        for contact, limb in zip(contacts, limbs or self._likely_limbs(contacts, place), strict=True):
            grip = (place, contact.centre_h_m, contact.axis, contact.tangent, self.gravity_h, contact.up)
            off, axis, up = contact.centre_h_m - place, contact.axis, contact.up
            at = (off[0], off[1], off[2]), (up[0], up[1], up[2]), (axis[0], axis[1], axis[2])
            numbers = self.problem.limb_masses[limb].at(*at)
            given.append(np.concatenate([numbers, *grip]))
            limits.append(self.limits_Nm[limb])
        size = len(given[0]) - _GRIP
        return list(zip(*_torque_map(size)(np.array(given)), limits, strict=True))

    def _likely_limbs(self, contacts: list[Contact], place: Array) -> list[int]:
        """Which limb is on each contact, by where it is."""
        away, limbs = np.array([contact.centre_h_m[:2] - place[:2] for contact in contacts]), []
        for at in away:
            column = away[away[:, 1] * at[1] >= 0.0, 0]
            side = np.where(at >= [column.mean() if len(column) > 1 else 0.0, 0.0], 1.0, -1.0)
            limbs.append(int(np.argmax((self._quadrant == side).all(axis=1))))
        return limbs

    def _solve_within(self, query: Query, about: Array, limbs: tuple[int, ...] | None = None) -> Array | None:
        """A body position in balance near that wanted, with torques as they are at another."""
        support = query.support
        joints = self.limits_Nm.shape[1]
        rows = np.zeros((2 * joints * len(support), 3 + WRENCH * len(support)))
        right = np.zeros(len(rows))
        for i, (torques, still, limit) in enumerate(self._torques(support, about, limbs)):
            at = slice(2 * joints * i, 2 * joints * (i + 1))
            rows[at, 3 + WRENCH * i : 7 + WRENCH * i] = np.vstack([torques, -torques])
            right[at] = np.concatenate([limit - still, limit + still])
        return self._solve(query, (rows, right))


@cache
def _torque_map(size: int) -> Mapped:
    """(a limb's numbers (size,), place, centre, axis, tangent, gravity, up) -> A (S, 4), b (S,).

    Torques are A @ (s1, s2, m, F) + b.
    """
    return Mapped.kept(("torque map", size), lambda: _make_torque_map(size))


def _make_torque_map(size: int) -> Mapped:
    given, w = ca.SX.sym("given", size + _GRIP), ca.SX.sym("w", 4)
    ends = [0, *range(size, size + _GRIP + 3, 3)]
    numbers, place, centre, axis, tangent, gravity, up = ca.vertsplit(given, ends)
    force = 2 * w[0] * tangent + 2 * w[1] * up + w[3] * axis
    pose = ca.vertcat(place, ca.DM.zeros(3))
    torques = joint_torques(size, tilted=True)(numbers, pose, centre, axis, force, 2 * w[2] * axis, gravity, up)
    still = ca.substitute(torques, w, ca.DM.zeros(4))
    return Mapped("torque_map", [given], [ca.jacobian(torques, w), still])
