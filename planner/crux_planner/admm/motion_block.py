"""P2b, equation (19b): delta near eta + epsilon under (7), (8) and (9), one NLP, compiled once and used again.

Fingers and forces are free of contacts here: any finger may push anywhere, as long as the limbs reach it and the body
moves by its dynamics.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.physics.bounds import body_bounds
from crux_planner.physics.cost import body_cost
from crux_planner.physics.dynamics import centre_of_mass, euler_step
from crux_planner.physics.reach import offset_in_body
from crux_planner.solvers.ipopt import AGAIN, Nlp
from crux_planner.trajectory.consensus import FINGERS, Eta, Scales

_POSE = 5  # x, y, z, yaw, opening of a gripper
_FORCE_UNIT_N, _MOMENT_UNIT_NM = 10.0, 0.1  # of the NLP's variables
_FORCE_BOUND_N, _MOMENT_BOUND_NM = 200.0, 5.0


class MotionBlock:
    """P2b of one problem. With `body_weight` 1 it also carries J's terms of the body (the NLP of P3)."""

    def __init__(self, problem: Problem, *, scales: Scales, body_weight: float = 0.0) -> None:
        self.problem, self.iterations, self.solved = problem, 0, True
        n = problem.steps
        x = ca.MX.sym("x", BODY_STATES, n + 1)
        g = ca.MX.sym("g", 4 * _POSE, n + 1)
        u = ca.MX.sym("u", 6 * FINGERS, n)
        kinematic, dynamic = BODY_STATES + 3 * FINGERS + 4, 6 * FINGERS
        to_x, to_u = ca.MX.sym("to_x", kinematic, n + 1), ca.MX.sym("to_u", dynamic, n)
        rho = ca.MX.sym("rho")
        units = _units(scales)
        near = ca.sumsqr(_kinematics().map(n + 1)(x, g) * units[0] - to_x * units[0])
        near += ca.sumsqr(u * units[1] * _INPUT_UNITS - to_u * units[1])
        cost = rho / 2 * near + body_weight * ca.sum2(_body_cost(problem).map(n + 1)(x))
        steps = _step(problem).map(n)(x[:, :-1], g[:, :-1], u) - x[:, 1:]
        reach = _reach().map(n)(x[:, 1:], g[:, 1:])
        rows = ca.veccat(steps, reach)
        parameters = ca.veccat(rho, to_x, to_u)
        nlp = {"x": ca.veccat(x, g, u), "p": parameters, "f": cost, "g": rows}
        self._bounds = self._variable_bounds()
        low, high = _reach_bounds(problem)
        equal = np.zeros(BODY_STATES * n)
        row_bounds = np.concatenate([equal, np.tile(low, n)]), np.concatenate([equal, np.tile(high, n)])
        self._nlp = Nlp(nlp, self._bounds, row_bounds, AGAIN)

    def project(self, target: Eta, rho: float) -> Eta:
        """argmin rho / 2 |delta - target|^2; starts from the last answer, the first time from the target."""
        to_x = np.concatenate([target.body, target.fingers.reshape(len(target.body), -1), target.yaws], axis=1)
        to_u = _inputs(target)
        low, high = self._bounds
        first = np.concatenate([target.body.ravel(), _poses(target).ravel(), (to_u / np.array(_INPUT_UNITS).T).ravel()])
        parameters = np.concatenate([[rho], to_x.ravel(), to_u.ravel()])
        found = self._nlp.solve(np.clip(first, low, high), parameters, again=True)
        self.solved, self.iterations = found.solved, found.iterations
        return self._eta(found.x)

    def _eta(self, values: Array) -> Eta:
        n = self.problem.steps
        a, b = BODY_STATES * (n + 1), (BODY_STATES + 4 * _POSE) * (n + 1)
        body, poses = values[:a].reshape(n + 1, BODY_STATES), values[a:b].reshape(n + 1, 4 * _POSE)
        all_knots = np.array(_kinematics().map(n + 1)(body.T, poses.T)).T
        inputs = values[b:].reshape(n, -1) * np.array(_INPUT_UNITS).T
        return Eta(
            body,
            all_knots[:, BODY_STATES:-4].reshape(n + 1, FINGERS, 3),
            all_knots[:, -4:],
            inputs[:, : 3 * FINGERS].reshape(n, FINGERS, 3),
            inputs[:, 3 * FINGERS :].reshape(n, FINGERS, 3),
        )

    def _variable_bounds(self) -> tuple[Array, Array]:
        """(7)."""
        problem, n = self.problem, self.problem.steps
        low_x, high_x = body_bounds(problem, None)
        shape, free = problem.shape, np.inf
        low_g = np.tile([-free, -free, 0.0, -free, shape.smallest_opening], 4)
        high_g = np.tile([free, free, problem.swing.max_height_m, free, shape.largest_opening], 4)
        high_u = np.repeat([_FORCE_BOUND_N / _FORCE_UNIT_N, _MOMENT_BOUND_NM / _MOMENT_UNIT_NM], 3 * FINGERS)
        low = np.concatenate([low_x.ravel(), np.tile(low_g, n + 1), -np.tile(high_u, n)])
        high = np.concatenate([high_x.ravel(), np.tile(high_g, n + 1), np.tile(high_u, n)])
        return low, high


_INPUT_UNITS = ca.DM(np.repeat([_FORCE_UNIT_N, _MOMENT_UNIT_NM], 3 * FINGERS))


def _units(scales: Scales) -> tuple[ca.DM, ca.DM]:
    """Weights of the norm: of body, fingers and yaws; of forces and moments."""
    state = [scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6
    kinematic = [*state, *[scales.position] * (3 * FINGERS), *[scales.orientation] * 4]
    return ca.DM(kinematic), ca.DM(np.repeat([scales.force, scales.moment], 3 * FINGERS))


def _inputs(eta: Eta) -> Array:
    n = len(eta.forces)
    return np.concatenate([eta.forces.reshape(n, -1), eta.moments.reshape(n, -1)], axis=1)


def _poses(eta: Eta) -> Array:
    """Gripper poses (N + 1, 20) from finger positions."""
    first, second = eta.fingers[:, 0::2], eta.fingers[:, 1::2]
    opening = np.linalg.norm(first - second, axis=2) / 2
    poses = np.concatenate([(first + second) / 2, eta.yaws[..., None], opening[..., None]], axis=2)
    flat: Array = poses.reshape(len(poses), -1)
    return flat


def gripper_fingers(g: Any) -> list[Any]:
    """(9b): the eight finger positions."""
    points = []
    for limb in range(4):
        pose = g[_POSE * limb : _POSE * (limb + 1)]
        half = pose[4] * ca.vertcat(ca.cos(pose[3]), ca.sin(pose[3]), 0)
        points += [pose[:3] + half, pose[:3] - half]
    return points


def _kinematics() -> ca.Function:
    x, g = ca.SX.sym("x", BODY_STATES), ca.SX.sym("g", 4 * _POSE)
    yaws = [g[_POSE * limb + 3] for limb in range(4)]
    return ca.Function("kinematics", [x, g], [ca.vertcat(x, *gripper_fingers(g), *yaws)])


def _step(problem: Problem) -> ca.Function:
    """(8a) and (8b)."""
    x, g, u = ca.SX.sym("x", BODY_STATES), ca.SX.sym("g", 4 * _POSE), ca.SX.sym("u", 6 * FINGERS)
    scaled = u * _INPUT_UNITS
    force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    for i, point in enumerate(gripper_fingers(g)):
        each = scaled[3 * i : 3 * i + 3]
        force += each
        moment += ca.cross(point, each) + scaled[3 * (FINGERS + i) : 3 * (FINGERS + i) + 3]
    centre = centre_of_mass(problem, x, [g[_POSE * limb : _POSE * limb + 4] for limb in range(4)])
    step = euler_step(x, force, moment, centre, problem)
    return ca.Function("step", [x, g, u], [step])


def _reach() -> ca.Function:
    """(9a): grippers in the body frame, and their yaws relative to the body's."""
    x, g = ca.SX.sym("x", BODY_STATES), ca.SX.sym("g", 4 * _POSE)
    offsets = [offset_in_body(x[0:3], x[3:6], g[_POSE * limb : _POSE * limb + 3]) for limb in range(4)]
    turns = [g[_POSE * limb + 3] - x[5] for limb in range(4)]
    return ca.Function("reach", [x, g], [ca.vertcat(*offsets, *turns)])


def _reach_bounds(problem: Problem) -> tuple[Array, Array]:
    middle, half = problem.boxes.centre_b_m.ravel(), np.tile(problem.boxes.half_m, 4)
    low, high = problem.gripper_yaw_rad
    return np.append(middle - half, [low] * 4), np.append(middle + half, [high] * 4)


def _body_cost(problem: Problem) -> ca.Function:
    x = ca.SX.sym("x", BODY_STATES)
    return ca.Function("body_cost", [x], [body_cost(x, problem)])
