"""P2a with its binaries fixed as one sparse QP: body states, inputs of the contacts, footholds where feet are free.

A contact, a knot and a limb in stance each, has inputs of its own kind: a gripper's wrench or a foot's force. (8) is
linear about a given motion. Climbs and walks add their own rows and costs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import BODY_STATES, CentroidalProblem
from crux_planner.physics.cost import state_weights
from crux_planner.solvers.qp import Qp, QpSolution
from crux_planner.solvers.sparse_blocks import Entries, Rows

if TYPE_CHECKING:
    from crux_planner.trajectory.consensus import Eta, Scales

FREE = 1e3  # a bound beyond what matters keeps the QP compact
MOMENT_OF_FORCE = slice(9, 12)  # rows of (8b)'s moments among a knot's


class CentroidalQp:
    """The QP over contacts at `places` (P, 2), knot and limb, with `width` inputs each, and so many footholds."""

    def __init__(self, problem: CentroidalProblem, places: Indices, width: int, footholds: int = 0) -> None:
        self.problem, self.places = problem, places
        n, at_u = problem.steps, BODY_STATES * (problem.steps + 1)
        self.at_h = at_u + width * len(places)
        self.size = self.at_h + 2 * footholds
        self.states = np.arange(at_u).reshape(n + 1, BODY_STATES)
        self.inputs = np.arange(at_u, self.at_h).reshape(-1, width)
        self.footholds = np.arange(self.at_h, self.size).reshape(-1, 2)
        self.rows, self.equations, self.right = Rows(), Entries(), np.zeros((n, BODY_STATES))
        self.diagonal, self.linear = np.zeros(self.size), np.zeros(self.size)
        self.hessian = sp.csc_matrix((self.size, self.size))  # beyond the diagonal

    def squares(self, index: Indices, weight: Array | float, wanted: Array | float) -> None:
        """Add weight * |x[index] - wanted|^2."""
        weight, wanted = np.broadcast_to(weight, index.shape), np.broadcast_to(wanted, index.shape)
        np.add.at(self.diagonal, index, 2 * weight)
        np.add.at(self.linear, index, -2 * weight * wanted)

    def add_body_cost(self, rho: float, target: Eta | None, scales: Scales | None) -> None:
        """|x - x_g|_Q^2, and rho / 2 |x - target|^2 where there is a target."""
        self.squares(self.states, *state_weights(self.problem))
        if target is not None and scales is not None:
            unit = np.array([scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6)
            self.squares(self.states, rho / 2 * unit**2, target.body)

    def add_dynamics(self, force: Array, spin: Array, lean: Array) -> None:
        """(8) by explicit Euler: `force` (P, 3, m) [N] and `spin` (P, 3, m) [rad/s^2] of an input, `lean` (N, 3, 3)
        [rad/s^2] of a metre that the body moves; what is constant of them is left to `right`.
        """
        dt, knots = self.problem.dt_s, np.arange(self.problem.steps)
        at, u = BODY_STATES * self.places[:, 0], self.inputs[:, 0]
        self.equations.blocks(at + 6, u, -dt / self.problem.mass_kg * force)
        self.equations.blocks(at + 9, u, -dt * spin)
        self.equations.blocks(BODY_STATES * knots + 9, BODY_STATES * knots, -dt * lean)
        one = np.ones(self.states[1:].size)
        now, then, rate = self.states[:-1].ravel(), self.states[1:].ravel(), self.states[:-1, 6:].ravel()
        self.equations.entries(now, now, -one)
        self.equations.entries(now, then, one)
        self.equations.entries(rate - 6, rate, np.full(rate.shape, -dt))
        self.right[:, 6:9] += dt * self.problem.gravity_h

    def solve(self, low: Array, high: Array, *, moments: bool, accuracy: float, iterations: int) -> QpSolution | None:
        """The solution between bounds, its multipliers (N, 12) of (8); None where none was found. Without `moments`
        (8b)'s are left open.
        """
        asked = np.ones(self.right.shape, dtype=bool)
        asked[:, MOMENT_OF_FORCE] = moments
        equations = self.equations.matrix((asked.size, self.size)).tocsr()
        keep = asked.ravel() & (np.diff(equations.indptr) > 0)  # limbs alone have none
        found = Qp(
            sp.diags(self.diagonal, format="csc") + self.hessian,
            self.linear,
            (equations[keep].tocsc(), self.right.ravel()[keep]),
            self.rows.all(self.size),
            np.maximum(low, -FREE),
            np.minimum(high, FREE),
            eps_abs=accuracy,
            eps_rel=accuracy / 10,
            max_iter=iterations,
        ).solve()
        multipliers = np.zeros(self.right.size)
        multipliers[keep] = found.multipliers
        return replace(found, multipliers=multipliers.reshape(self.right.shape)) if found.solved else None
