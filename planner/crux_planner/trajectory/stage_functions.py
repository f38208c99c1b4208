"""The exact P1 stage by stage: every equation of `terms` with its derivatives, evaluated for all knots at once.

A column is a knot and a limb; its variables are u = (q, a): the gripper's wrench and the spines' share, both scaled.
Hessians are those of the multipliers' product with the equations. Nothing here depends on the schedule, so one set of
functions serves every plan of a problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.mass import centres_and_slopes
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.physics.cost import body_cost, wrench_cost
from crux_planner.physics.dynamics import WRENCH_INPUTS, centre_of_mass, euler_step, gripper_wrench
from crux_planner.physics.limit_surface import surface_slack
from crux_planner.physics.reach import offset_in_body
from crux_planner.physics.torque import interval_torques

FORCE_SCALE_N = 10.0  # forces in tens of newtons, so that the numbers are of order one
SPINE_WEIGHT = 1e-4  # spines and friction may share a load in many ways: a little cost picks one
COLUMN = WRENCH_INPUTS + 3
POSE = 6  # of the body's states: position and orientation
_WRENCH = 6


class Equations(NamedTuple):
    """The equations alone, as functions of casadi's columns."""

    step: ca.Function  # (x, total, hands)
    reach: ca.Function  # (x, grippers)
    surface: ca.Function  # (u, fingers)
    torques: list[ca.Function]  # (x, q, grasp) of each limb
    body_cost: ca.Function  # (x)
    column_cost: ca.Function  # (u)


@dataclass(frozen=True)
class StageFunctions:
    """Equations of one problem, each vectorised over a leading axis."""

    problem: Problem

    def started_elsewhere(self, problem: Problem) -> StageFunctions:
        """The functions of a problem that differs in its start alone: of all equations only (8b)'s inertia does."""
        for name in ("_reach", "_surface", "_torques", "_torque_values", "_wrench", "_body_cost", "_column_cost"):
            getattr(self, name)  # made once, here
        other = StageFunctions(problem)
        other.__dict__.update({name: kept for name, kept in self.__dict__.items() if name not in ("problem", "_step")})
        return other

    @cached_property
    def scale(self) -> Array:
        """(5,) units of q: newtons and newton metres."""
        return np.array([1.0, 1.0, self.problem.patch.k_m, 1.0, 1.0]) * FORCE_SCALE_N

    @property
    def equations(self) -> Equations:
        """The same for a solver that differentiates by itself."""
        torques = [mapped.equation for mapped in self._torque_values]
        x, total, hands = (ca.SX.sym(name, n) for name, n in (("x", BODY_STATES), ("w", 6), ("hands", 16)))
        centre = centre_of_mass(self.problem, x, ca.vertsplit(hands, 4))
        after = euler_step(x, total[0:3], total[3:6], centre, self.problem)
        step = ca.Function("step", [x, total, hands], [after])
        reach, surface = self._reach.equation, self._surface.equation
        return Equations(step, reach, surface, torques, self._body_cost.equation, self._column_cost.equation)

    def step(self, x: Array, total: Array, hands: Array, multiplier: Array) -> tuple[Array, Array, Array, Array, Array]:
        """F, dF/dx, dF/dW, d2(lF)/dx2, d2(lF)/dxdW at (n, 12), (n, 6), grippers' places and yaws (n, 16), (n, 12).

        Second derivatives take the centre of mass as linear in the pose.
        """
        centre, slope = centres_and_slopes(self.problem, x[:, :POSE], hands.reshape(-1, 4, 4))
        slope = slope.swapaxes(1, 2).reshape(-1, 3 * POSE)  # casadi counts down the columns
        found: tuple[Array, Array, Array, Array, Array] = self._step(x, total, centre, slope, x[:, :POSE], multiplier)
        return found

    def reach(self, x: Array, grippers: Array, multiplier: Array) -> tuple[Array, Array, Array]:
        """Offsets (n, 4 m) of (9a), their derivatives (n, 4 m, 6) by the pose, and the Hessian (n, 6, 6)."""
        found: tuple[Array, Array, Array] = self._reach(x, grippers, multiplier)
        return found

    def surface(self, u: Array, fingers: Array, multiplier: Array) -> tuple[Array, Array, Array]:
        """Slack (n, m) of (2) or its stand-in, finger 1's rows first, derivatives (n, m, 8), Hessian (n, 8, 8).

        `fingers` (n, 4): friction of both, and 1 or 0 for those with and without spines.
        """
        found: tuple[Array, Array, Array] = self._surface(u, fingers, multiplier)
        return found

    def torque(self, limb: int, x: Array, q: Array, grasps: Array) -> tuple[Array, Array]:
        """Joint torques (n, 12) at both ends of intervals and their derivatives (n, 12, 17) by the body state and q."""
        found: tuple[Array, Array] = self._torques[limb](x, q, grasps)
        return found

    def torque_values(self, limb: int, x: Array, q: Array, grasps: Array) -> Array:
        """Joint torques (n, 12) alone: most climbs never need more."""
        (found,) = self._torque_values[limb](x, q, grasps)
        values: Array = found
        return values

    def wrench_maps(self, grasps: Array) -> Array:
        """(n, 6, 5): force and moment about the origin for scaled q, at grasps (n, 9) centre, axis, tangent."""
        found: Array = self._wrench(grasps)[0]
        return found

    @property
    def surface_rows(self) -> int:
        """m of `surface`."""
        return int(self._surface.function.size1_out(0))

    def body_cost(self, x: Array) -> tuple[Array, Array, Array]:
        """Cost, gradient, Hessian of (n, 12)."""
        found: tuple[Array, Array, Array] = self._body_cost(x)
        return found

    def column_cost(self, u: Array) -> tuple[Array, Array, Array]:
        """Cost, gradient, Hessian of (n, 8)."""
        found: tuple[Array, Array, Array] = self._column_cost(u)
        return found

    @cached_property
    def _step(self) -> _Mapped:
        p = self.problem
        sizes = {"x": BODY_STATES, "w": 6, "c": 3, "slope": 3 * POSE, "at": POSE, "l": BODY_STATES}
        x, total, centre, by_pose, at, multiplier = arguments = [ca.SX.sym(*each) for each in sizes.items()]
        centre = centre + ca.reshape(by_pose, 3, POSE) @ (x[:POSE] - at)
        step = euler_step(x, total[0:3], total[3:6], centre, p)
        slope = ca.gradient(ca.dot(multiplier, step), x)
        outputs = [step, ca.jacobian(step, x), ca.jacobian(step, total), ca.jacobian(slope, x)]
        return _function("step", arguments, [*outputs, ca.jacobian(slope, total)])

    @cached_property
    def _reach(self) -> _Mapped:
        x, grippers, along = ca.SX.sym("x", BODY_STATES), ca.SX.sym("c", 12), ca.DM(self.problem.boxes.directions)
        offsets = ca.vertcat(*[along @ offset_in_body(x[0:3], x[3:6], grippers[3 * i : 3 * i + 3]) for i in range(4)])
        multiplier = ca.SX.sym("z", offsets.size1())
        hessian = ca.hessian(ca.dot(multiplier, offsets), x)[0][:POSE, :POSE]
        return _function("reach", [x, grippers, multiplier], [offsets, ca.jacobian(offsets, x)[:, :POSE], hessian])

    @cached_property
    def _surface(self) -> _Mapped:
        p, scale = self.problem, self.scale
        u, fingers = ca.SX.sym("u", COLUMN), ca.SX.sym("fingers", 4)
        loads, wrench, share = fingers[:2] * u[3:5] * scale[3:], u[0:3] * scale[:3], u[5:8] * scale[:3]
        slack = ca.vertcat(
            *[surface_slack(p.limit_surface, wrench, fingers[2 + i] * share, loads[i], p.patch.k_m) for i in (0, 1)]
        )
        slack /= FORCE_SCALE_N
        multiplier = ca.SX.sym("z", slack.size1())
        hessian = ca.hessian(ca.dot(multiplier, slack), u)[0]
        return _function("surface", [u, fingers, multiplier], [slack, ca.jacobian(slack, u), hessian])

    @cached_property
    def _torque_terms(self) -> tuple[list[Any], Any, list[Any]]:
        """Arguments, what to differentiate by, and the joint torques of every limb in an interval."""
        p = self.problem
        x, q, grasp = ca.SX.sym("x", BODY_STATES), ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("grasp", 9)
        torques = [interval_torques(m, x, q * self.scale, grasp, p.gravity_w, p.dt_s) for m in p.limb_masses]
        return [x, q, grasp], ca.vertcat(x, q), torques

    @cached_property
    def _torques(self) -> list[_Mapped]:
        arguments, by, torques = self._torque_terms
        return [_function(f"torques_{i}", arguments, [t, ca.jacobian(t, by)]) for i, t in enumerate(torques)]

    @cached_property
    def _torque_values(self) -> list[_Mapped]:
        arguments, _, torques = self._torque_terms
        return [_function(f"torque_values_{i}", arguments, [t]) for i, t in enumerate(torques)]

    @cached_property
    def _wrench(self) -> _Mapped:
        q, grasp = ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("grasp", 9)
        force, moment = gripper_wrench(q * self.scale, grasp[0:3], grasp[3:6], grasp[6:9])
        return _function("wrench", [grasp], [ca.jacobian(ca.vertcat(force, moment), q)])

    @cached_property
    def _body_cost(self) -> _Mapped:
        x = ca.SX.sym("x", BODY_STATES)
        return _with_derivatives("body_cost", body_cost(x, self.problem), x)

    @cached_property
    def _column_cost(self) -> _Mapped:
        u = ca.SX.sym("u", COLUMN)
        cost = wrench_cost(u[0:5] * self.scale, self.problem) + SPINE_WEIGHT * ca.sumsqr(u[5:8])
        return _with_derivatives("column_cost", cost, u)


def _function(name: str, arguments: list[Any], outputs: list[Any]) -> _Mapped:
    return _Mapped(ca.Function(name, arguments, [ca.densify(output) for output in outputs], {"cse": True}))


def _with_derivatives(name: str, cost: Any, by: Any) -> _Mapped:
    hessian, gradient = ca.hessian(cost, by)
    return _function(name, [by], [cost, gradient, hessian])


class _Mapped:
    """A casadi function at many places at once; reads and writes numpy's memory without a copy."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._shapes = [function.size_out(i) for i in range(function.n_out())]
        self._at: dict[int, tuple[Any, Any]] = {}  # by number of places

    @property
    def equation(self) -> ca.Function:
        """The first output, of the arguments that it depends on."""
        arguments = self.function.sx_in()
        value = self.function(*arguments)
        value = value[0] if self.function.n_out() > 1 else value
        needed = [argument for argument in arguments if ca.depends_on(value, argument)]
        return ca.Function(self.function.name(), needed, [value])

    def __call__(self, *arguments: Array) -> Any:
        """At every row of the arguments (n, size): outputs (n, rows), or (n, rows, columns) of a matrix."""
        n = len(arguments[0])
        if n not in self._at:
            self._at[n] = self.function.map(n).buffer()
        buffer, run = self._at[n]
        given = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        found = [np.empty((n, columns, rows)) for rows, columns in self._shapes]
        for i, argument in enumerate(given):
            buffer.set_arg(i, argument.data)
        for i, values in enumerate(found):
            buffer.set_res(i, values.data)
        run()
        return tuple(v[:, 0] if v.shape[1] == 1 else v.swapaxes(1, 2) for v in found)
