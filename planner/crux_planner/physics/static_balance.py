"""What balance is made of: (8) at rest, and (2)+(3) with its inner polytope for (2), linear for every contact.

The centre of mass of a level body is taken as linear in the places of its origin and its grippers
(model.mass.linear_centre). A gripper's wrench is w = (s1, s2, m, F): shear and twist of a finger, net force along the
axis.
"""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.mass import linear_centre
from crux_planner.model.problem import Problem
from crux_planner.physics.dynamics import static_map
from crux_planner.physics.limit_surface import finger_limits, polytope_directions
from crux_planner.solvers.sparse_blocks import skews

_LEVEL = np.eye(3)


def _map(contact: Contact) -> Array:
    moments = contact.leaning_moments if contact.leans else None
    return static_map(contact.centre_h_m, contact.axis, contact.tangent, moments, contact.up)


class StaticBalance:
    """Of one problem, with `margin` of the limit surface; contacts are indices into `problem.contacts`."""

    def __init__(self, problem: Problem, margin: float) -> None:
        self.problem, self.margin = problem, margin
        self.maps = np.stack([_map(c) for c in problem.contacts])  # (C, 6, 4)
        self.directions, self.reach = polytope_directions(problem.patch.k_m)
        self.limits = [finger_limits(c.grip_friction, margin * c.spines, c.lean_rad) for c in problem.contacts]
        # Of both fingers in all directions, (C, 2, 26): load borne a newton of normal force, and what spines hold.
        self.load = margin * np.array([np.outer(c.grip_friction, self.reach) for c in problem.contacts])
        self.spine = margin * np.array([c.spines for c in problem.contacts]) @ np.abs(self.directions).T
        self.max_normal_N = margin * problem.patch.max_normal_N
        # Most that fingers 1 and 2 may press: bounds of the net force F along the axis, up and down.
        self.press_N = self.max_normal_N * np.array([c.may_press for c in problem.contacts])
        self.centres = np.stack([c.centre_h_m for c in problem.contacts])  # (C, 3)
        self._follow, self._rest = linear_centre(problem)

    def mean_place(self, contacts: tuple[int, ...]) -> Array:
        """(3,) of these contacts."""
        mean: Array = self.centres[list(contacts)].mean(axis=0)
        return mean

    def centre(self, grippers: Array, to_h: Array = _LEVEL) -> tuple[Array, Array]:
        """(3, 3) A and (3,) b: the centre of mass of a body at r, its axes turned by `to_h`, is at A @ r + b where its
        grippers' mean place is `grippers` (3,).
        """
        follow = to_h @ self._follow @ to_h.T
        return np.eye(3) - follow, follow @ grippers + to_h @ self._rest

    def weight(self, grippers: Array, to_h: Array = _LEVEL) -> tuple[Array, Array]:
        """(6, 3) A and (6,) b: in balance, A @ r and the grippers' forces and moments about the origin sum to b."""
        (moved, still), turn = self.centre(grippers, to_h), skews(self.problem.weight_N)
        return np.vstack([np.zeros((3, 3)), -turn @ moved]), np.append(-self.problem.weight_N, turn @ still)
