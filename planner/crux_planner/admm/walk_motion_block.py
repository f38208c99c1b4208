"""P2b of walking, equation (19b): delta near eta + epsilon under (7), (8) and (9a), one NLP, compiled once.

Feet and forces are free of contacts here: any foot may push anywhere, as long as the limbs reach it and the body moves
by its dynamics.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.cost import body_cost
from crux_planner.physics.dynamics import centre_over_feet, euler_step
from crux_planner.physics.reach import offset_in_body
from crux_planner.physics.walk_bounds import body_bounds, rate_steps
from crux_planner.solvers.ipopt import AGAIN, Nlp
from crux_planner.trajectory.consensus import Eta, Scales

_FEET = 4
FORCE_UNIT_N = 10.0
_FORCE_BOUND_N = 200.0


class WalkMotion:
    """P2b of one walk. With `body_weight` 1 it also carries J's terms of the body (the NLP of P3)."""

    def __init__(self, problem: WalkProblem, scales: Scales, *, body_weight: float = 0.0) -> None:
        self.problem, self.iterations, self.solved = problem, 0, True
        n = problem.steps
        x = ca.MX.sym("x", BODY_STATES, n + 1)
        p = ca.MX.sym("p", 3 * _FEET, n + 1)
        u = ca.MX.sym("u", 3 * _FEET, n)
        to_x, to_p = ca.MX.sym("to_x", BODY_STATES, n + 1), ca.MX.sym("to_p", 3 * _FEET, n + 1)
        to_u, rho = ca.MX.sym("to_u", 3 * _FEET, n), ca.MX.sym("rho")
        units = ca.DM([scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6)
        near = ca.sumsqr((x - to_x) * units) + scales.position**2 * ca.sumsqr(p - to_p)
        near += (scales.force * FORCE_UNIT_N) ** 2 * ca.sumsqr(u - to_u)
        cost = rho / 2 * near + body_weight * ca.sum2(walk_body_cost(problem).map(n + 1)(x))
        steps = walk_step(problem).map(n)(x[:, :-1], p[:, :-1], u) - x[:, 1:]
        reach = walk_reach().map(n)(x[:, 1:], p[:, 1:])
        rates = x[6:12, 1:] - x[6:12, :-1]
        parameters = ca.veccat(rho, to_x, to_p, to_u)
        nlp = {"x": ca.veccat(x, p, u), "p": parameters, "f": cost, "g": ca.veccat(steps, reach, rates)}
        low, high = body_bounds(problem, None)
        foot_low, foot_high = [-np.inf, -np.inf, 0.0] * _FEET, [np.inf, np.inf, problem.step_height_m] * _FEET
        force = np.full(3 * _FEET * n, _FORCE_BOUND_N / FORCE_UNIT_N)
        self._bounds = (
            np.concatenate([low.ravel(), np.tile(foot_low, n + 1), -force]),
            np.concatenate([high.ravel(), np.tile(foot_high, n + 1), force]),
        )
        middle, half = problem.boxes.centre_b_m.ravel(), np.tile(problem.boxes.half_m, _FEET)
        equal = np.zeros(BODY_STATES * n)
        row_bounds = (
            np.concatenate([equal, np.tile(middle - half, n), np.tile(-rate_steps(problem), n)]),
            np.concatenate([equal, np.tile(middle + half, n), np.tile(rate_steps(problem), n)]),
        )
        self._nlp = Nlp(nlp, self._bounds, row_bounds, AGAIN)

    def project(self, target: Eta, rho: float) -> Eta:
        """argmin rho / 2 |delta - target|^2; starts from the last answer, the first time from the target."""
        wanted = np.concatenate([target.body.ravel(), target.fingers.ravel(), target.forces.ravel() / FORCE_UNIT_N])
        low, high = self._bounds
        found = self._nlp.solve(np.clip(wanted, low, high), np.concatenate([[rho], wanted]), again=True)
        self.solved, self.iterations = found.solved, found.iterations
        return self._eta(found.x)

    def _eta(self, values: Array) -> Eta:
        n = self.problem.steps
        a, b = BODY_STATES * (n + 1), (BODY_STATES + 3 * _FEET) * (n + 1)
        return Eta(
            values[:a].reshape(n + 1, BODY_STATES),
            values[a:b].reshape(n + 1, _FEET, 3),
            np.zeros((n + 1, 0)),
            FORCE_UNIT_N * values[b:].reshape(n, _FEET, 3),
            np.zeros((n, 0, 3)),
        )


def walk_step(problem: WalkProblem) -> ca.Function:
    """(8a) and (8b): the next state from x, feet and their forces [FORCE_UNIT_N]."""
    x, p, u = ca.SX.sym("x", BODY_STATES), ca.SX.sym("p", 3 * _FEET), ca.SX.sym("u", 3 * _FEET)
    force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    for i in range(_FEET):
        each = FORCE_UNIT_N * u[3 * i : 3 * i + 3]
        force += each
        moment += ca.cross(p[3 * i : 3 * i + 3], each)
    centre = centre_over_feet(problem, x, p, ca.repmat(x[5], _FEET))  # the feet turn with the body, about
    step = euler_step(x, force, moment, centre, problem)
    return ca.Function("step", [x, p, u], [step])


def walk_reach() -> ca.Function:
    """(9a): feet in the body frame."""
    x, p = ca.SX.sym("x", BODY_STATES), ca.SX.sym("p", 3 * _FEET)
    offsets = [offset_in_body(x[0:3], x[3:6], p[3 * i : 3 * i + 3]) for i in range(_FEET)]
    return ca.Function("reach", [x, p], [ca.vertcat(*offsets)])


def walk_body_cost(problem: WalkProblem) -> ca.Function:
    """J's terms of a knot's body state."""
    x = ca.SX.sym("x", BODY_STATES)
    return ca.Function("body_cost", [x], [body_cost(x, problem)])
