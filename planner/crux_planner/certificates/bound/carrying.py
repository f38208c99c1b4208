"""The least a grasp costs for given multipliers of force and moment: |u|^2_R against (2)-(4) and (7), in closed form.

With multipliers pi = (pi_F, pi_M) of the six rows of balance, what a gripper adds to the Lagrangian is
    min over q of  R |q|^2 + g . q,   q = (s1, s2, m / k, n1, n2),   g = map' pi,
subject to |s - a_i| <= mu_i n_i, |a_i| <= spines_i, 0 <= n_i <= most for fingers i. The cheapest s for loads mu_i n_i
of at least t is a projection onto a box with rounded edges, so that one number is left, t: a convex function made of
parabolas. Every number returned is exact, whatever the multipliers are, but for grips with spines on one finger: there
it is the larger of what the grip costs with spines on both fingers, and with no limit for the finger that has spines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem
from crux_planner.physics.dynamics import static_map

_UNLIMITED = 1e9  # a friction beyond any; its inverse is no friction


@dataclass(frozen=True)
class Carriers:
    """What the grasps of a problem can carry; contacts that differ by the swap of the fingers carry the same."""

    maps: Array  # (C, 6, 4): force and moment about the origin of (s1, s2, m / k, F), F = n1 - n2
    friction: Array  # (C, 2) of fingers 1 and 2
    spines: Array  # (C, 3) largest share of the spines in (s1, s2, m / k) [N]
    most_N: float
    weight: float  # R
    bare: Carriers | None = None  # from above once more: the finger without spines decides, where there is one

    @staticmethod
    def of(problem: Problem) -> Carriers:
        """All contacts of a problem."""
        k_m, share = problem.patch.k_m, problem.friction_share
        maps = np.stack([static_map(c.centre_h_m, c.axis, c.tangent) for c in problem.contacts])
        maps[:, :, 2] *= k_m
        friction = share * np.array([c.grip_friction for c in problem.contacts])
        spines = share * np.array([c.spines for c in problem.contacts]) / [1.0, 1.0, k_m]  # (C, 2, 3)
        rest = share * problem.patch.max_normal_N, problem.weights.wrench
        one_sided = (spines[:, 0] != spines[:, 1]).any(axis=1)
        bare = None
        if one_sided.any():
            without = one_sided[:, None] & (spines > 0.0).any(axis=2)
            bare = Carriers(maps, np.where(without, _UNLIMITED, friction), spines.min(axis=1), *rest)
        return Carriers(maps, friction, spines.max(axis=1), *rest, bare)

    def least(self, multipliers: Array, contacts: Indices | None = None) -> Array:
        """The least of R |q|^2 + multipliers . map q for multipliers about the origin.

        (..., C) for multipliers (..., 6) and every contact, or (n,) for multipliers (n, 6) of one contact each.
        """
        w, high = self.weight, self.most_N
        if contacts is None:
            friction, spines = self.friction, self.spines
            g = np.einsum("cij,...i->...cj", self.maps, multipliers)
        else:
            friction, spines = self.friction[contacts], self.spines[contacts]
            g = np.einsum("cij,ci->cj", self.maps[contacts], multipliers)
        best, _ = _least(g, friction, spines, w, high)
        return best if self.bare is None else np.maximum(best, self.bare.least(multipliers, contacts))

    def wrenches(self, multipliers: Array, contacts: Indices) -> tuple[Array, Array]:
        """`least` (n, C) of each of some contacts for multipliers (n, 6), and with it force and moment (n, C, 6)."""
        maps = self.maps[contacts]
        g = np.einsum("cij,ni->ncj", maps, multipliers)
        best, q = _least(g, self.friction[contacts], self.spines[contacts], self.weight, self.most_N)
        wrench = np.einsum("cij,ncj->nci", maps, q)
        if self.bare is None:
            return best, wrench
        other, bare = self.bare.wrenches(multipliers, contacts)
        return np.maximum(best, other), np.where((other > best)[..., None], bare, wrench)


def _least(g: Array, friction: Array, spines: Array, w: float, high: float) -> tuple[Array, Array]:
    """The least for slopes g (..., 4) of (s1, s2, m / k, F), and these where it is."""
    wanted = -g[..., :3] / (4 * w)  # the cheapest shear and twist, were there no limit
    beyond = np.maximum(np.abs(wanted) - spines, 0.0)
    over = np.linalg.norm(beyond, axis=-1)
    pull, press = np.abs(g[..., 3]), 1.0 / np.maximum(friction, 1.0 / _UNLIMITED)  # normal force a newton of load
    second = g[..., 3] > 0.0
    payer, other = np.where(second, press[:, 1], press[:, 0]), np.where(second, press[:, 0], press[:, 1])
    pressure = np.minimum(pull / (2 * w), high)  # the cheapest normal force on the finger that pays
    # t: load of each finger. Up to `edge` the one that pays has `pressure`; above, both have what t needs.
    edge = pressure / payer
    one = np.clip((4 * w * over - pull * other) / (4 * w + 2 * w * other**2), 0.0, np.minimum(edge, high / other))
    squares, slope = payer**2 + other**2, pull * (other - payer)
    both = np.clip((4 * w * over - slope) / (4 * w + 2 * w * squares), edge, high / np.maximum(payer, other))
    below = w * (other * one) ** 2 + pull * other * one + w * pressure**2 - pull * pressure
    below += 2 * w * np.maximum(over - one, 0.0) ** 2
    above = w * squares * both**2 + slope * both + 2 * w * np.maximum(over - both, 0.0) ** 2
    paid = (both >= edge) & (above < below)
    best: Array = np.where(paid, above, below) - 2 * w * (wanted**2).sum(axis=-1)
    load = np.where(paid, both, one)
    less = np.sign(wanted) * beyond * (1.0 - np.minimum(load / np.maximum(over, 1e-12), 1.0))[..., None]
    normal = np.where(paid, payer * both, pressure) - other * load
    return best, np.concatenate([wanted - less, np.where(second, -normal, normal)[..., None]], axis=-1)
