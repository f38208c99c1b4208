"""P2b, equation (19b): delta near eta + epsilon under (7), (8) and (9), one NLP, compiled once and used again.

Contacts play no part here: any finger and any foot may push anywhere, as long as the limbs reach it and the body moves
by its dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES, CentroidalProblem, Problem
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.bounds import body_bounds, rate_steps, walk_bounds
from crux_planner.physics.cost import body_cost
from crux_planner.physics.dynamics import centre_of_mass, euler_step, on_feet
from crux_planner.physics.reach import offset_in_body
from crux_planner.solvers.ipopt import AGAIN, Nlp
from crux_planner.trajectory.consensus import Eta, Scales

FORCE_UNIT_N, _MOMENT_UNIT_NM = 10.0, 0.1  # of the NLP's variables
_FORCE_BOUND_N, _MOMENT_BOUND_NM = 200.0, 5.0
POSE = 5  # x, y, z, yaw, opening of a gripper


@dataclass(frozen=True)
class Ends:
    """The ends of the four limbs as variables of a knot: poses (5,) of grippers with two fingers, or point feet (3,).

    `low` and `high` bound those of a limb; `yaw_rad` its yaw relative to the body, None for feet.
    """

    low: Array
    high: Array
    yaw_rad: tuple[float, float] | None

    @classmethod
    def of(cls, problem: CentroidalProblem) -> Ends:
        """Those of a climb or a walk."""
        free = np.inf
        if isinstance(problem, Problem):
            shape, top = problem.shape, problem.swing.max_height_m
            low = np.array([-free, -free, 0.0, -free, shape.smallest_opening])
            return cls(low, np.array([free, free, top, free, shape.largest_opening]), problem.gripper_yaw_rad)
        assert isinstance(problem, WalkProblem)
        return cls(np.array([-free, -free, 0.0]), np.array([free, free, problem.step_height_m]), None)

    @property
    def size(self) -> int:
        """Variables of all four."""
        return 4 * len(self.low)

    @property
    def fingers(self) -> int:
        """Points that push."""
        return 8 if self.yaw_rad else 4

    @property
    def units(self) -> Array:
        """Of the inputs of a knot: all forces, then all moments where fingers have them."""
        forces = np.full(3 * self.fingers, FORCE_UNIT_N)
        return np.append(forces, np.full(3 * self.fingers, _MOMENT_UNIT_NM)) if self.yaw_rad else forces

    @property
    def bounds(self) -> Array:
        """Of the same, in these units."""
        forces = np.full(3 * self.fingers, _FORCE_BOUND_N)
        return (np.append(forces, np.full(3 * self.fingers, _MOMENT_BOUND_NM)) if self.yaw_rad else forces) / self.units

    def each(self, g: Any) -> list[Any]:
        """The limbs' own rows of a knot's variables."""
        own = len(self.low)
        return [g[own * limb : own * (limb + 1)] for limb in range(4)]

    def points(self, g: Any) -> list[Any]:
        """(9b): where the fingers or feet are (casadi)."""
        if self.yaw_rad is None:
            return self.each(g)
        half = [pose[4] * ca.vertcat(ca.cos(pose[3]), ca.sin(pose[3]), 0) for pose in self.each(g)]
        return [pose[:3] + sign * h for pose, h in zip(self.each(g), half, strict=True) for sign in (1, -1)]

    def kinematics(self) -> ca.Function:
        """Body state, points and yaws of a knot: what is in the consensus."""
        x, g = ca.SX.sym("x", BODY_STATES), ca.SX.sym("g", self.size)
        yaws = [pose[3] for pose in self.each(g)] if self.yaw_rad else []
        return ca.Function("kinematics", [x, g], [ca.vertcat(x, *self.points(g), *yaws)])

    def step(self, problem: CentroidalProblem) -> ca.Function:
        """(8a) and (8b): the next state from x, ends and inputs in their units."""
        x, g, u = ca.SX.sym("x", BODY_STATES), ca.SX.sym("g", self.size), ca.SX.sym("u", self.units.size)
        scaled, after = u * ca.DM(self.units), 3 * self.fingers
        force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
        for i, point in enumerate(self.points(g)):
            each = scaled[3 * i : 3 * i + 3]
            force += each
            twist = scaled[after + 3 * i : after + 3 * i + 3] if self.yaw_rad else ca.SX.zeros(3)
            moment += ca.cross(point, each) + twist
        if isinstance(problem, WalkProblem):  # the feet turn with the body, about
            hands = on_feet(problem, g, ca.repmat(x[5], 4))
        else:
            hands = [pose[:4] for pose in self.each(g)]
        step = euler_step(x, force, moment, centre_of_mass(problem, x, hands), problem)
        return ca.Function("step", [x, g, u], [step])

    def reach(self) -> ca.Function:
        """(9a): where the limbs end in the body frame, and their yaws relative to the body's."""
        x, g = ca.SX.sym("x", BODY_STATES), ca.SX.sym("g", self.size)
        offsets = [offset_in_body(x[0:3], x[3:6], end[:3]) for end in self.each(g)]
        turns = [pose[3] - x[5] for pose in self.each(g)] if self.yaw_rad else []
        return ca.Function("reach", [x, g], [ca.vertcat(*offsets, *turns)])

    def reach_bounds(self, problem: CentroidalProblem) -> tuple[Array, Array]:
        """Of `reach`."""
        middle, half = problem.boxes.centre_b_m.ravel(), np.tile(problem.boxes.half_m, 4)
        low, high = ([bound] * 4 for bound in self.yaw_rad) if self.yaw_rad else ([], [])
        return np.append(middle - half, low), np.append(middle + half, high)


def body_cost_function(problem: CentroidalProblem) -> ca.Function:
    """J's terms of a knot's body state."""
    x = ca.SX.sym("x", BODY_STATES)
    return ca.Function("body_cost", [x], [body_cost(x, problem)])


class MotionBlock:
    """P2b of one climb or walk. With `body_weight` 1 it also carries J's terms of the body (the NLP of P3)."""

    def __init__(self, problem: CentroidalProblem, *, scales: Scales, body_weight: float = 0.0) -> None:
        self.problem, self.iterations, self.solved = problem, 0, True
        self._ends = ends = Ends.of(problem)
        n, inputs = problem.steps, ends.units.size
        kinematics = ends.kinematics()
        self._kinematics = kinematics.map(n + 1)
        x, g, u = ca.MX.sym("x", BODY_STATES, n + 1), ca.MX.sym("g", ends.size, n + 1), ca.MX.sym("u", inputs, n)
        to_x, to_u = ca.MX.sym("to_x", kinematics.size1_out(0), n + 1), ca.MX.sym("to_u", inputs, n)
        rho = ca.MX.sym("rho")
        state = [scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6
        yaws = kinematics.size1_out(0) - BODY_STATES - 3 * ends.fingers
        state = [(1.0 - body_weight) * unit for unit in state]  # what no other block has is in no consensus
        unit_x = ca.DM([*state, *[scales.position] * (3 * ends.fingers), *[scales.orientation] * yaws])
        unit_u = ca.DM(np.repeat([scales.force, scales.moment], 3 * ends.fingers)[:inputs])
        near = ca.sumsqr(self._kinematics(x, g) * unit_x - to_x * unit_x)
        near += ca.sumsqr(u * unit_u * ca.DM(ends.units) - to_u * unit_u)
        cost = rho / 2 * near + body_weight * ca.sum2(body_cost_function(problem).map(n + 1)(x))
        rows = [ends.step(problem).map(n)(x[:, :-1], g[:, :-1], u) - x[:, 1:], ends.reach().map(n)(x[:, 1:], g[:, 1:])]
        equal = np.zeros(BODY_STATES * n)
        low, high = ([equal, np.tile(bound, n)] for bound in ends.reach_bounds(problem))
        if isinstance(problem, WalkProblem):
            rows.append(x[6:12, 1:] - x[6:12, :-1])
            low.append(np.tile(-rate_steps(problem), n))
            high.append(np.tile(rate_steps(problem), n))
            low_x, high_x = walk_bounds(problem, None)
        else:
            assert isinstance(problem, Problem)
            low_x, high_x = body_bounds(problem, None)
        most = np.tile(ends.bounds, n)
        self._bounds = (
            np.concatenate([low_x.ravel(), np.tile(ends.low, 4 * (n + 1)), -most]),
            np.concatenate([high_x.ravel(), np.tile(ends.high, 4 * (n + 1)), most]),
        )
        nlp = {"x": ca.veccat(x, g, u), "p": ca.veccat(rho, to_x, to_u), "f": cost, "g": ca.veccat(*rows)}
        self._nlp = Nlp(nlp, self._bounds, (np.concatenate(low), np.concatenate(high)), AGAIN)

    def project(self, target: Eta, rho: float) -> Eta:
        """argmin rho / 2 |delta - target|^2; starts from the last answer, the first time from the target."""
        n, (low, high) = self.problem.steps, self._bounds
        to_x = np.concatenate([target.body, target.fingers.reshape(n + 1, -1), target.yaws], axis=1)
        to_u = np.concatenate([target.forces.reshape(n, -1), target.moments.reshape(n, -1)], axis=1)
        first = np.concatenate([target.body.ravel(), self._first(target).ravel(), (to_u / self._ends.units).ravel()])
        parameters = np.concatenate([[rho], to_x.ravel(), to_u.ravel()])
        found = self._nlp.solve(np.clip(first, low, high), parameters, again=True)
        if not found.solved:  # the last answer leads nowhere
            found = self._nlp.solve(np.clip(first, low, high), parameters)
        self.solved, self.iterations = found.solved, found.iterations
        return self._eta(found.x)

    def _first(self, eta: Eta) -> Array:
        """Ends (N + 1, 4, 5 or 3) from the positions of fingers or feet."""
        if self._ends.yaw_rad is None:
            return eta.fingers
        one, two = eta.fingers[:, 0::2], eta.fingers[:, 1::2]
        opening = np.linalg.norm(one - two, axis=2) / 2
        return np.concatenate([(one + two) / 2, eta.yaws[..., None], opening[..., None]], axis=2)

    def _eta(self, values: Array) -> Eta:
        n, fingers = self.problem.steps, self._ends.fingers
        a, b = BODY_STATES * (n + 1), (BODY_STATES + self._ends.size) * (n + 1)
        body = values[:a].reshape(n + 1, BODY_STATES)
        known = np.array(self._kinematics(body.T, values[a:b].reshape(n + 1, -1).T)).T
        inputs = values[b:].reshape(n, -1) * self._ends.units
        points, yaws = np.split(known[:, BODY_STATES:], [3 * fingers], axis=1)
        forces, moments = np.split(inputs, [3 * fingers], axis=1)
        of_each = (n, fingers, 3)
        return Eta(
            body,
            points.reshape(n + 1, fingers, 3),
            yaws,
            forces.reshape(of_each),
            moments.reshape(of_each if moments.size else (n, 0, 3)),
        )
