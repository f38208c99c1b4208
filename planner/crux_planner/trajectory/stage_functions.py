"""The exact P1 stage by stage: every equation of `terms` with its derivatives, evaluated for all knots at once.

A column is a knot and a limb; its variables are u = (q, a): the gripper's wrench and the spines' share, both scaled.
Hessians are those of the multipliers' product with the equations. Nothing here depends on the schedule, so one set of
functions serves every plan of a problem.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import casadi as ca
import numpy as np
from crux_contracts.robot_bounds import JOINTS

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.chain_limb import Layout
from crux_planner.model.hands import TILTED, rotations
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.limb import NUMBERS
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.bounds import body_bounds, reach_bounds
from crux_planner.physics.cost import body_cost, wrench_cost
from crux_planner.physics.dynamics import WRENCH_INPUTS, centre_of_mass, euler_step, gripper_wrench, next_pose
from crux_planner.physics.limit_surface import in_face, surface_slack
from crux_planner.physics.reach import offset_in_body
from crux_planner.physics.torque import GRASP, LEANING, UP, held_torques, leaning_moment, up_of
from crux_planner.solvers.mapped import Mapped

FORCE_SCALE_N = 10.0  # forces in tens of newtons, so that the numbers are of order one
SPINE_WEIGHT = 1e-4  # spines and friction may share a load in many ways: a little cost picks one
COLUMN = WRENCH_INPUTS + 3
POSE = 6  # of the body's states: position and orientation
_WRENCH = 6
_TURNING = 12  # numbers: inertia and gravity
_TorqueGiven = tuple[tuple[float, ...], float, int, int]
"""Units of q, the length of an interval, S of limbs without a closed form, 0 where they have one, and how many numbers
a grasp has: all that torques depend on beside their functions' arguments."""
_GIVEN = 8  # such sets of which functions are kept: they take a fifth of a plan's time to make


@dataclass(frozen=True)
class Between:
    """Rows of reach at shares (B,) of intervals (B,), the body (B, 6) off the straight way there: grippers (B, n) as
    `reach_at` takes them, and bounds (B, m).
    """

    intervals: Indices
    share: Array
    off: Array
    grippers: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class StageFunctions:
    """Equations of one problem, each vectorised over a leading axis."""

    problem: Problem

    short_steps, most_iterations = 8, 80
    """Of the interior-point method: steps in a row, each of little of a Newton step, and all, before it gives up."""

    def grippers(self, schedule: Schedule) -> Array:
        """Of knots 1..N, (N, n) as `reach` takes them."""
        return schedule.poses[1:, :, :3].reshape(len(schedule.poses) - 1, -1)

    def body_bounds(self, problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
        """Lower and upper bounds (N + 1, 12) of the body's states."""
        return body_bounds(problem, schedule)

    def reach_at(self, body: Array, grippers: Array, multiplier: Array) -> tuple[Array, Array, Array]:
        """Rows (n, m) of (9a), their derivatives (n, m, 6) and Hessian (n, 6, 6), as `reach` has them."""
        rows, slopes, hessian = self.reach(body, grippers, multiplier)
        return rows, slopes, hessian

    def reach_bounds(self, problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
        """Lower and upper bounds (N, m) of the rows of `reach` at knots 1..N."""
        return reach_bounds(problem, schedule)

    def between(self) -> Between:
        """Rows of `reach_at` between the knots: none here, where knots alone are asked for."""
        none = np.zeros((0, 0))
        return Between(np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, POSE)), none, none, none)

    def started_elsewhere(self, problem: Problem) -> Self:
        """The functions of a problem that differs in its start alone: of all equations only (8b)'s inertia does."""
        other = copy(self)
        other.__dict__["problem"] = problem
        return other

    @cached_property
    def scale(self) -> Array:
        """(5,) units of q: newtons and newton metres."""
        return np.array([1.0, 1.0, self.problem.patch.k_m, 1.0, 1.0]) * FORCE_SCALE_N

    def torque_hessian(
        self, limbs: Indices, poses: tuple[Array, Array], by_state: Array, q: Array, grasps: Array, multiplier: Array
    ) -> Array:
        """Hessian (n, 17, 17) of multipliers (n, 2 S) times the torques of limbs (n,): body poses (n, 6) at both ends
        of the intervals, the latter's derivatives (n, 6, 12) by the body state; these are taken as constant.
        """
        first = np.broadcast_to(np.eye(POSE, BODY_STATES), by_state.shape)
        found = np.zeros((len(limbs), BODY_STATES + WRENCH_INPUTS, BODY_STATES + WRENCH_INPUTS))
        for pose, slope, z in zip(poses, (first, by_state), np.split(multiplier, 2, axis=1), strict=True):
            by = np.zeros((len(limbs), POSE + WRENCH_INPUTS, found.shape[-1]))
            by[:, :POSE, :BODY_STATES], by[:, POSE:, BODY_STATES:] = slope, np.eye(WRENCH_INPUTS)
            numbers = self._with_gravity(self._numbers_at(limbs, pose, grasps))
            curvature = _torque_curvature(self._torque_given)(pose, q, grasps, numbers, z)[0]
            found += by.swapaxes(-1, -2) @ curvature @ by
        return found

    @property
    def surface_rows(self) -> int:
        """m of `surface`."""
        return int(self.surface.tape.shapes[0, 0])

    def step(self, body: Array, totals: Array, hands: Array, multipliers: Array) -> Any:
        """F, dF/dx, dF/dW, d2(lF)/dx2, d2(lF)/dxdW at (n, 12), (n, 6), hands (n, 16 or 24), (n, 12).

        Second derivatives take the centre of mass as linear in the pose.
        """
        turning = np.concatenate([self.problem.inertia_b.ravel(order="F"), self.problem.gravity_h])
        given = body, totals, self.with_seeds(body, hands), multipliers
        return self._step(*given, np.broadcast_to(turning, (len(body), _TURNING)))

    @property
    def layout(self) -> Layout:
        """Of the limbs' numbers; of no joints where they have a closed form."""
        return Layout(self.problem.chain_slots)

    @property
    def hand_numbers(self) -> int:
        """Of four hands, and where there is no closed form what kinematics start from."""
        return 4 * self.problem.hand_numbers + 4 * self.layout.seed

    def with_seeds(self, body: Array, hands: Array) -> Array:
        """(n, `hand_numbers`) of body states (n, 12) and hands (n, 16 or 24)."""
        if self.problem.closed_form:
            return hands
        seeds = []
        for limb, hand in enumerate(np.split(hands, 4, axis=1)):
            turned, limbs = rotations(hand), np.full(len(hand), limb)
            grasp = np.hstack([hand[:, :3], turned[:, :, 0], turned[:, :, 1], turned[:, :, 2]])
            numbers = self._numbers_at(limbs, body[:, :POSE], grasp)
            seeds.append(numbers[:, self.layout.chain :])
        return np.hstack([hands, *seeds])

    def limb_numbers(self, hands: Any) -> list[Any]:
        """What kinematics take of each limb, of such hands (casadi)."""
        own = [ca.DM(limb.numbers) for limb in self.problem.limb_masses]
        if self.problem.closed_form:
            return own
        return [
            ca.vertcat(*each)
            for each in zip(own, ca.vertsplit(hands[4 * self.problem.hand_numbers :], self.layout.seed), strict=True)
        ]

    @property
    def _step(self) -> Mapped:
        """Also of inertia (9) and gravity (3), which the start's posture and heading decide."""
        p = self.problem
        own = tuple(self._numbers.ravel().tolist()), tuple(p.body_moment_kg_m.tolist()), p.mass_kg
        given = "step", own, p.dt_s, p.chain_slots, p.hand_numbers
        return Mapped.once(given, lambda: Mapped.kept(given, self._make_step))

    def _make_step(self) -> Mapped:
        sizes = {"x": BODY_STATES, "w": _WRENCH, "hands": self.hand_numbers, "l": BODY_STATES, "turning": _TURNING}
        x, total, hands, multiplier, turning = arguments = [ca.SX.sym(*each) for each in sizes.items()]
        at, by_pose, pose = ca.SX.sym("c", 3), ca.SX.sym("slope", 3, POSE), ca.SX.sym("at", POSE)
        inertia: Any = ca.reshape(turning[:9], 3, 3)
        gravity: Any = turning[9:]
        p = replace(self.problem, inertia_b=inertia, gravity_h=gravity)
        step = euler_step(x, total[0:3], total[3:6], at + by_pose @ (x[:POSE] - pose), p)
        slope = ca.gradient(ca.dot(multiplier, step), x)
        outputs = [step, ca.jacobian(step, x), ca.jacobian(step, total), ca.jacobian(slope, x)]
        outputs.append(ca.jacobian(slope, total))
        linear = ca.Function("linear", [x, total, multiplier, turning, at, by_pose, pose], outputs)
        centre = centre_of_mass(
            p, x, ca.vertsplit(hands[: 4 * p.hand_numbers], p.hand_numbers), self.limb_numbers(hands)
        )
        by_pose = ca.jacobian(centre, x)[:, :POSE]
        return Mapped("step", arguments, linear(x, total, multiplier, turning, centre, by_pose, x[:POSE]))

    @cached_property
    def reach(self) -> Mapped:
        """Rows (n, m) of (9a), here offsets along the directions of the reach; their derivatives (n, m, 6) by the pose,
        and the Hessian (n, 6, 6), at (n, 12), grippers (n, 12) and multipliers (n, m).
        """
        return Mapped.once(("reach", self.problem.boxes.directions.tobytes()), self._make_reach)

    def _make_reach(self) -> Mapped:
        x, grippers, along = ca.SX.sym("x", BODY_STATES), ca.SX.sym("c", 12), ca.DM(self.problem.boxes.directions)
        offsets = ca.vertcat(*[along @ offset_in_body(x[0:3], x[3:6], grippers[3 * i : 3 * i + 3]) for i in range(4)])
        multiplier = ca.SX.sym("z", offsets.size1())
        hessian = ca.hessian(ca.dot(multiplier, offsets), x)[0][:POSE, :POSE]
        return Mapped("reach", [x, grippers, multiplier], [offsets, ca.jacobian(offsets, x)[:, :POSE], hessian])

    @cached_property
    def surface(self) -> Mapped:
        """Slack (n, m) of (2) or its stand-in, finger 1's rows first, derivatives (n, m, 8), Hessian (n, 8, 8).

        At (n, 8), fingers (n, 4): friction of both, 1 or 0 for those with and without spines; where some faces lean (n,
        8): cosine and sine of both; multipliers (n, m).
        """
        p = self.problem
        given = "surface", p.limit_surface, p.patch.k_m, p.leans, tuple(self.scale)
        return Mapped.once(given, self._make_surface)

    def _make_surface(self) -> Mapped:
        p, scale = self.problem, self.scale
        u, fingers = ca.SX.sym("u", COLUMN), ca.SX.sym("fingers", 8 if p.leans else 4)
        loads, wrench, share = fingers[:2] * u[3:5] * scale[3:], u[0:3] * scale[:3], u[5:8] * scale[:3]
        of_finger = [(wrench, loads[0]), (wrench, loads[1])]
        for i in (0, 1) if p.leans else ():
            lift, press = in_face(wrench[1], u[3 + i] * scale[3 + i], fingers[4 + i], fingers[6 + i])
            of_finger[i] = ca.vertcat(wrench[0], lift, wrench[2]), fingers[i] * press
        spiny = ((load, fingers[2 + i] * share, bears) for i, (load, bears) in enumerate(of_finger))
        slack = ca.vertcat(*[surface_slack(p.limit_surface, *each, p.patch.k_m) for each in spiny])
        slack /= FORCE_SCALE_N
        multiplier = ca.SX.sym("z", slack.size1())
        hessian = ca.hessian(ca.dot(multiplier, slack), u)[0]
        return Mapped("surface", [u, fingers, multiplier], [slack, ca.jacobian(slack, u), hessian])

    @cached_property
    def _numbers(self) -> Array:
        """(4, 36) of the limbs, or (4, 10 S + 16)."""
        return np.array([limb.numbers for limb in self.problem.limb_masses])

    def numbers_over(self, limbs: Indices, body: Array, grasps: Array) -> Array:
        """(n, 39) or (n, 24 S + 19) that torques of limbs (n,) over intervals need, at body states (n, 12) and grasps,
        with gravity.
        """
        if self.problem.closed_form:
            return self._with_gravity(self._numbers[limbs])
        then = _next_poses(self.problem.dt_s)(body)[0]
        first, second = (self._numbers_at(limbs, poses, grasps) for poses in (body[:, :POSE], then))
        return self._with_gravity(np.hstack([first, second[:, self.layout.chain :]]))

    def _with_gravity(self, numbers: Array) -> Array:
        return np.hstack([numbers, np.broadcast_to(self.problem.gravity_h, (len(numbers), 3))])

    def _numbers_at(self, limbs: Indices, poses: Array, grasps: Array) -> Array:
        """(n, 36) or (n, 17 S + 16) of limbs (n,) at body poses (n, 6), grippers' centre and axis first in `grasps`."""
        if self.problem.closed_form:
            return self._numbers[limbs]
        to_b = np.swapaxes(rotation_from_rpy(poses[:, 3:]), 1, 2)
        off = (to_b @ (grasps[:, :3] - poses[:, :3])[..., None])[..., 0].T
        axis, up = (to_b @ grasps[:, 3:6, None])[..., 0].T, to_b[:, :, 2].T
        if self.problem.hand_numbers == TILTED:
            up = (to_b @ grasps[:, GRASP : GRASP + UP, None])[..., 0].T
        found = np.zeros((len(limbs), self.layout.chain + self.layout.seed))
        for limb, masses in enumerate(self.problem.limb_masses):
            at = np.flatnonzero(limbs == limb)
            gripper, upward, along = ((v[0, at], v[1, at], v[2, at]) for v in (off, up, axis))
            found[at] = masses.at(gripper, upward, along).T
        return found

    @property
    def grasp_numbers(self) -> int:
        """Of a grasp, as physics.torque takes it."""
        tilted, leans = self.problem.hand_numbers == TILTED, self.problem.leans
        return GRASP + (UP if tilted else 0) + (LEANING if leans else 0)

    @cached_property
    def _torque_given(self) -> _TorqueGiven:
        return tuple(self.scale.tolist()), self.problem.dt_s, self.problem.chain_slots, self.grasp_numbers

    @property
    def torque_values(self) -> Mapped:
        """Joint torques (n, 2 S) at both ends of intervals, at body states, q, grasps and `numbers_over` intervals."""
        return _torque_values(self._torque_given)

    @property
    def torques(self) -> Mapped:
        """The same and their derivatives (n, 2 S, 17) by the body state and q."""
        return _torques(self._torque_given)

    @cached_property
    def wrench_maps(self) -> Mapped:
        """(n, 6, 5): force and moment about the origin for scaled q, at grasps (n, `grasp_numbers`)."""
        return Mapped.once(("wrench", tuple(self.scale), self.grasp_numbers), self._make_wrench_maps)

    def _make_wrench_maps(self) -> Mapped:
        q, grasp = ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("grasp", self.grasp_numbers)
        force, moment = gripper_wrench(q * self.scale, grasp[0:3], grasp[3:6], grasp[6:9], *up_of(grasp))
        if self.problem.leans:
            moment += leaning_moment(grasp, q * self.scale)
        return Mapped("wrench", [grasp], [ca.jacobian(ca.vertcat(force, moment), q)])

    @cached_property
    def body_cost(self) -> Mapped:
        """Cost, gradient, Hessian of (n, 12)."""
        weights, goal = self.problem.weights, self.problem.goal.body
        x, given = ca.SX.sym("x", BODY_STATES), (weights, tuple(goal.position_m), tuple(goal.rpy_rad))
        return Mapped.once(("body", given), lambda: _with_derivatives("body_cost", body_cost(x, self.problem), x))

    @cached_property
    def column_cost(self) -> Mapped:
        """Cost, gradient, Hessian of (n, 8)."""
        given = "column", self.problem.weights.wrench, self.problem.patch.k_m, tuple(self.scale)
        return Mapped.once(given, self._make_column_cost)

    def _make_column_cost(self) -> Mapped:
        u = ca.SX.sym("u", COLUMN)
        cost = wrench_cost(u[0:5] * self.scale, self.problem) + SPINE_WEIGHT * ca.sumsqr(u[5:8])
        return _with_derivatives("column_cost", cost, u)


@lru_cache(_GIVEN)
def _torque_values(given: _TorqueGiven) -> Mapped:
    return Mapped.kept(("torque values", given), lambda: _make_torque_values(given))


def _make_torque_values(given: _TorqueGiven) -> Mapped:
    scale, dt_s, slots, grasp_numbers = given
    chain, seed = Layout(slots).chain, Layout(slots).seed
    count = chain + 2 * seed if slots else NUMBERS
    sizes = {"x": BODY_STATES, "q": WRENCH_INPUTS, "grasp": grasp_numbers, "numbers": count + 3}
    x, q, grasp, numbers = arguments = [ca.SX.sym(*each) for each in sizes.items()]
    poses, load = (x[:POSE], next_pose(x, dt_s)), (q * np.array(scale), grasp, numbers[count:])
    first = second = numbers[:count]
    if slots:
        first, second = numbers[: chain + seed], ca.vertcat(numbers[:chain], numbers[chain + seed : count])
    ends = [held_torques(own, pose, *load) for own, pose in zip((first, second), poses, strict=True)]
    return Mapped("torque_values", arguments, [ca.vertcat(*ends)])


@lru_cache(_GIVEN)
def _next_poses(dt_s: float) -> Mapped:
    x = ca.SX.sym("x", BODY_STATES)
    return Mapped("next_poses", [x], [next_pose(x, dt_s)])


@lru_cache(_GIVEN)
def _torques(given: _TorqueGiven) -> Mapped:
    return Mapped.kept(("torques", given), lambda: _make_torques(given))


def _make_torques(given: _TorqueGiven) -> Mapped:
    values = _make_torque_values(given).function
    x, q, *_ = arguments = values.sx_in()
    torques = values(*arguments)
    return Mapped("torques", arguments, [torques, ca.jacobian(torques, ca.vertcat(x, q))])


@lru_cache(_GIVEN)
def _torque_curvature(given: _TorqueGiven) -> Mapped:
    return Mapped.kept(("torque curvature", given), lambda: _make_torque_curvature(given))


def _make_torque_curvature(given: _TorqueGiven) -> Mapped:
    """Hessian (n, 11, 11) of multipliers (n, S) times the torques of limbs at body poses (n, 6)."""
    scale, _, slots, grasp_numbers = given
    count = Layout(slots).chain + Layout(slots).seed if slots else NUMBERS
    sizes = {"pose": POSE, "q": WRENCH_INPUTS, "grasp": grasp_numbers, "numbers": count + 3, "z": slots or JOINTS}
    pose, q, grasp, numbers, multiplier = arguments = [ca.SX.sym(*each) for each in sizes.items()]
    torques = held_torques(numbers[:count], pose, q * np.array(scale), grasp, numbers[count:])
    hessian = ca.hessian(ca.dot(multiplier, torques), ca.vertcat(pose, q))[0]
    return Mapped("torque_curvature", arguments, [hessian])


def _with_derivatives(name: str, cost: Any, by: Any) -> Mapped:
    hessian, gradient = ca.hessian(cost, by)
    return Mapped(name, [by], [cost, gradient, hessian])
