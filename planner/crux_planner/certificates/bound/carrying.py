"""The least a grasp costs for given multipliers of force and moment: |u|^2_R against (2)-(4) and (7), in closed form.

With multipliers pi = (pi_F, pi_M) of the six rows of balance, what a gripper adds to the Lagrangian is
    min over q of  R |q|^2 + g . q,   q = (s1, s2, m / k, n1, n2),   g = map' pi,
subject to |s - a| <= mu n_i, |a| <= spines, 0 <= n_i <= most. The cheapest s for normal forces of at least `n` is a
projection onto a box with rounded edges, so that one number is left, the smaller normal force: a convex function made
of parabolas. Every number returned is exact, whatever the multipliers are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem
from crux_planner.physics.dynamics import static_map


@dataclass(frozen=True)
class Carriers:
    """What the grasps of a problem can carry; contacts that differ by the swap of the fingers carry the same."""

    maps: Array  # (C, 6, 4): force and moment about the origin of (s1, s2, m / k, F), F = n1 - n2
    friction: Array  # (C,)
    spines: Array  # (C, 3) largest share of the spines in (s1, s2, m / k) [N]
    most_N: float
    weight: float  # R

    @staticmethod
    def of(problem: Problem) -> Carriers:
        """All contacts of a problem."""
        k_m, share = problem.patch.k_m, problem.friction_share
        maps = np.stack([static_map(c.centre_w_m, c.axis, c.tangent) for c in problem.contacts])
        maps[:, :, 2] *= k_m
        spines = np.array([[c.spine_shear_N, c.spine_shear_N, c.spine_twist_Nm / k_m] for c in problem.contacts])
        return Carriers(
            maps,
            share * np.array([c.grip_friction for c in problem.contacts]),
            share * spines,
            problem.friction_share * problem.patch.max_normal_N,
            problem.weights.wrench,
        )

    def least(self, multipliers: Array, contacts: Indices | None = None) -> Array:
        """The least of R |q|^2 + multipliers . map q for multipliers about the origin.

        (..., C) for multipliers (..., 6) and every contact, or (n,) for multipliers (n, 6) of one contact each.
        """
        w, high = self.weight, self.most_N
        if contacts is None:
            mu, spines = self.friction, self.spines
            g = np.einsum("cij,...i->...cj", self.maps, multipliers)
        else:
            mu, spines = self.friction[contacts], self.spines[contacts]
            g = np.einsum("cij,ci->cj", self.maps[contacts], multipliers)
        wanted = -g[..., :3] / (4 * w)  # the cheapest shear and twist, were there no limit
        over = np.linalg.norm(np.maximum(np.abs(wanted) - spines, 0.0), axis=-1)
        pull = np.abs(g[..., 3])
        pressure = np.minimum(pull / (2 * w), high)  # the cheapest normal force on the finger that pays
        # n: smaller normal force. Below `pressure`, the other finger has `pressure`; above, both have n.
        one = np.clip((4 * w * mu * over - pull) / (2 * w + 4 * w * mu**2), 0.0, pressure)
        both = np.clip(mu * over / (1 + mu**2), pressure, high)
        best = np.minimum(
            w * one**2 + pull * one + w * pressure**2 - pull * pressure + 2 * w * np.maximum(over - mu * one, 0.0) ** 2,
            2 * w * both**2 + 2 * w * np.maximum(over - mu * both, 0.0) ** 2,
        )
        least: Array = best - 2 * w * (wanted**2).sum(axis=-1)
        return least
