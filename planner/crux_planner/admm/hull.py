"""P2a of a climb on windows, equation (19a), as a MIP: a binary a limb, window and (hold, face pair), in hull form.

A limb is a unit flow over contacts: it stays, or takes an arc (a swing of whole windows). The wrench of a contact is
its own set of variables q = (s1, s2, m / k, F+, F-, n), zero unless the contact is held, so that the limit surface
(2)+(3) needs no big M; n is the smaller of the two normal forces n1 = n + F+ and n2 = n + F-, and the sign variable
gamma of (12) is not needed (physics.limit_surface); nor is beta of (14): arcs are swings that keep clear. Forces
balance (8a); moments (8b) are the NLP's, and in the rows only if asked for. HiGHS takes no quadratic MIP: squares enter
as tangents, in perspective form where they hang on a binary, more of them where answers have been (`touch`); the rows
do not depend on the ADMM's iteration, only the cost does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.windows import Arc, Windows
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.schedule import Schedule, Swinging
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers.milp import Milp, MilpResult

SHARES = 6  # q of one contact
SQUARED = 5  # s1, s2, m / k, n1, n2
ALL = tuple(range(len(LIMB_NAMES)))
_TANGENTS_N = (
    np.array([-24.0, -10.0, 10.0, 24.0]),
    np.array([-24.0, -10.0, 10.0, 24.0]),
    np.array([-6.0, 6.0]),
    np.array([4.0, 10.0, 20.0, 40.0]),
    np.array([4.0, 10.0, 20.0, 40.0]),
)
_TANGENT_STEP_M = 0.04
_FORCE_BOUND_N = 150.0


@dataclass
class WindowCost:
    """What the MILP minimises, equation (19a) summed over each window's knots.

    Contacts: `linear` (S, 4, C, 6) on q, `square` (S, 5) on the squares of s1, s2, m / k, n1, n2, `held` (S, 4, C) on
    the binaries. Body: `body_linear` (S, 3) and `body_square` (S, 3). Arcs: one number each, by limb. With the constant
    it is J and the consensus term, of which a gap is a share.
    """

    square: Array
    body_linear: Array
    body_square: Array
    linear: Array
    held: Array
    arcs: list[Array]
    constant: float = 0.0


@dataclass(frozen=True)
class Decision:
    """Contacts decided: arcs taken per limb, body positions (S, 3), the objective and its proven lower bound."""

    swings: list[Swinging]
    body: Array
    objective: float
    bound: float
    values: Array = field(repr=False)


class HullMilp:
    """The rows of P2a on windows; of some limbs alone, without what ties them to the others and the body."""

    def __init__(
        self, windows: Windows, balance: StaticBalance, limbs: Sequence[int] = ALL, *, moments: bool = False
    ) -> None:
        self.windows, self.balance, self.limbs = windows, balance, limbs
        self.milp = Milp()
        low, high = windows.body_range()
        self.body = np.stack([self.milp.variables(3, low, high) for _ in range(windows.count)])
        self.body_squares = np.stack([self.milp.variables(3, 0.0, np.inf) for _ in range(windows.count)])
        self.held: list[list[dict[int, int]]] = [[{} for _ in ALL] for _ in range(windows.count)]
        self.wrench: list[list[dict[int, Indices]]] = [[{} for _ in ALL] for _ in range(windows.count)]
        self.squares: list[list[dict[int, Indices]]] = [[{} for _ in ALL] for _ in range(windows.count)]
        self.arcs = [self.milp.variables(len(windows.arcs[limb]), 0.0, 1.0) for limb in range(len(ALL))]
        for limb in limbs:
            self._flow(limb)
        for t in range(windows.count):
            self._wrenches(t)
        if limbs == ALL:  # what ties them together
            for limb in limbs:
                self._reach(limb)
            for t in range(windows.count):
                self._one_gripper_a_hold(t)
                self._out_of_the_way(t)
                self._forces(t)
                if moments:
                    self._moments(t)
            self._body_motion()

    def solve(
        self, cost: WindowCost, *, gap: float, time_limit_s: float, start: list[Swinging] | None = None
    ) -> MilpResult:
        """Minimise; `start` are swings known to be good, such as those of an earlier decision."""
        hint = None
        if start is not None:
            hint = np.full(self.milp.size, np.nan)
            for limb in self.limbs:
                for t, contact in enumerate(self.windows.held(limb, start)):
                    for c, column in self.held[t][limb].items():
                        hint[column] = float(c == contact)
        vector = self._cost(cost)
        return self.milp.solve(vector, constant=cost.constant, start=hint, gap=gap, time_limit_s=time_limit_s)

    def decision(self, result: MilpResult) -> Decision:
        """What a result says."""
        assert result.values is not None
        swings = []
        for limb in self.limbs:
            taken = [arc for arc, column in self._limb_arcs(limb) if result.values[column] > 0.5]
            swings += [self.windows.swinging(limb, arc) for arc in sorted(taken, key=lambda arc: arc.first)]
        return Decision(swings, result.values[self.body], result.objective, result.bound, result.values)

    def forbid(self, swings: tuple[Swinging, ...]) -> None:
        """Never take these swings together (a cut: it holds whatever the cost)."""
        columns = [
            column
            for swing in swings
            for arc, column in self._limb_arcs(swing.limb)
            if self.windows.swinging(swing.limb, arc) == swing
        ]
        self.milp.row(columns, np.ones(len(columns)), -np.inf, len(columns) - 1)

    def forbid_exactly(self, decision: Decision) -> None:
        """Never decide for exactly these contacts again (a no-good cut on the binaries)."""
        columns = [column for window in self.held for limb in window for column in limb.values()]
        on = decision.values[columns] > 0.5
        self.milp.row(columns, np.where(on, 1.0, -1.0), -np.inf, int(on.sum()) - 1)

    def _limb_arcs(self, limb: int) -> list[tuple[Arc, int]]:
        return list(zip(self.windows.arcs[limb], self.arcs[limb].tolist(), strict=True))

    def _flow(self, limb: int) -> None:
        windows, milp, start = self.windows, self.milp, self.windows.problem.start_contacts[limb]
        last = windows.count - 1
        for t in range(windows.count):
            for c in windows.contacts[limb]:
                low = 1.0 if t == 0 and c == start else 0.0
                high = 0.0 if (t == 0 and c != start) or (t == last and c not in windows.goals[limb]) else 1.0
                self.held[t][limb][c] = int(milp.variables(1, low, high, integer=True)[0])
        for t in range(1, windows.count):
            landing: dict[int, list[int]] = {c: [] for c in windows.contacts[limb]}
            leaving: dict[int, list[int]] = {c: [] for c in windows.contacts[limb]}
            for arc, column in self._limb_arcs(limb):
                if arc.end == t:
                    landing[arc.goal].append(column)
                if arc.first == t:
                    leaving[arc.start].append(column)
            for c in windows.contacts[limb]:
                now, before = self.held[t][limb][c], self.held[t - 1][limb][c]
                milp.row([now, *landing[c]], [1.0] + [-1.0] * len(landing[c]), 0.0, np.inf)
                columns = [now, before, *landing[c], *leaving[c]]
                signs = [1.0, -1.0] + [-1.0] * len(landing[c]) + [1.0] * len(leaving[c])
                milp.row(columns, signs, 0.0, 0.0)

    def _reach(self, limb: int) -> None:
        """(9a) with the body level: the body is where the contact held, or both ends of the swing, allow it."""
        windows, reach = self.windows, self.windows.reach
        for t in range(windows.count):
            low: list[Array] = [reach.low[limb, c] for c in self.held[t][limb]]
            high: list[Array] = [reach.high[limb, c] for c in self.held[t][limb]]
            columns = list(self.held[t][limb].values())
            for arc, column in self._limb_arcs(limb):
                if arc.first <= t < arc.end:
                    low.append(np.minimum(reach.low[limb, arc.start], reach.low[limb, arc.goal]))
                    high.append(np.maximum(reach.high[limb, arc.start], reach.high[limb, arc.goal]))
                    columns.append(column)
            self.milp.row(columns, np.ones(len(columns)), 1.0, 1.0)
            for axis in range(3):
                body = int(self.body[t, axis])
                self.milp.row([body, *columns], [1.0, *(-b[axis] for b in low)], 0.0, np.inf)
                self.milp.row([body, *columns], [1.0, *(-b[axis] for b in high)], -np.inf, 0.0)

    def _one_gripper_a_hold(self, t: int) -> None:
        problem, by_hold = self.windows.problem, dict[int, list[int]]()
        for limb in self.limbs:
            for c, column in self.held[t][limb].items():
                by_hold.setdefault(problem.contacts[c].hold, []).append(column)
            for arc, column in self._limb_arcs(limb):
                if arc.first <= t < arc.end:
                    by_hold.setdefault(problem.contacts[arc.goal].hold, []).append(column)
        for columns in by_hold.values():
            self.milp.row(columns, np.ones(len(columns)), -np.inf, 1.0)

    def _out_of_the_way(self, t: int) -> None:
        """No swing passes a gripper that stands in its way."""
        for limb in self.limbs:
            over = [(arc, column) for arc, column in self._limb_arcs(limb) if arc.first <= t < arc.end]
            for other in self.limbs:
                for c, held in self.held[t][other].items():
                    blocked = [column for arc, column in over if self.windows.blocks(limb, arc, other, c)]
                    if blocked:
                        self.milp.row([held, *blocked], np.ones(len(blocked) + 1), -np.inf, 1.0)

    def _wrenches(self, t: int) -> None:
        problem, balance, milp = self.windows.problem, self.balance, self.milp
        directions = balance.directions * np.array([1.0, 1.0, problem.patch.k_m])  # on (s1, s2, m / k)
        high = np.array([*[_FORCE_BOUND_N] * 3, *[balance.max_normal_N] * 3])
        low = np.array([-high[0], -high[1], -high[2], 0.0, 0.0, 0.0])
        for limb in self.limbs:
            for c, held in self.held[t][limb].items():
                q = milp.variables(SHARES, low, high)
                squares = milp.variables(SQUARED, 0.0, np.inf)
                self.wrench[t][limb][c], self.squares[t][limb][c] = q, squares
                for finger, limit in enumerate(balance.limits[c]):
                    more = [q[3 + finger]] * abs(limit.side)  # of a finger's normal force, beside the squeeze q[5]
                    for direction, load, spine in zip(
                        directions, balance.load[c, finger], balance.spine[c, finger], strict=True
                    ):
                        loads = [-load] * (1 + len(more))
                        milp.row([*q[:3], q[5], *more, held], [*direction, *loads, -spine], -np.inf, 0.0)
                for pull, press in zip((3, 4), balance.press_N[c], strict=True):
                    milp.row([q[pull], q[5], held], [1.0, 1.0, -press], -np.inf, 0.0)
                for i, tangents in enumerate(_TANGENTS_N):
                    for d in tangents:
                        self._tangent(t, limb, c, i, float(d))

    def touch(self, wrenches: list[dict[int, Array]], schedule: Schedule) -> None:
        """Tangents at the mean wrenches (s1, s2, m, n1, n2) of a window's knots, by knot and limb in stance."""
        unit = np.array([1.0, 1.0, self.windows.problem.patch.k_m, 1.0, 1.0])
        for t in range(self.windows.count):
            knots = range(*self.windows.span(t))
            for limb in self.limbs:
                for c in self.held[t][limb]:
                    known = [wrenches[k][limb] for k in knots if schedule.contacts[k][limb] == c]
                    for i, d in enumerate(np.mean(known, axis=0) / unit if known else ()):
                        self._tangent(t, limb, c, i, float(d))

    def _tangent(self, t: int, limb: int, c: int, i: int, d: float) -> None:
        """The square of number i of a contact's, at d: in perspective form, 0 where it is not held."""
        q, squares = self.wrench[t][limb][c], self.squares[t][limb][c]
        base = [int(q[i])] if i < 3 else [int(q[5]), int(q[i])]
        columns = [int(squares[i]), *base, self.held[t][limb][c]]
        self.milp.row(columns, [1.0, *([-2 * d] * len(base)), d * d], 0.0, np.inf)

    def _forces(self, t: int) -> None:
        """(8a), at rest."""
        columns, parts, weight = list[int](), list[Array](), self.windows.problem.weight_N
        for limb in self.limbs:
            for c, q in self.wrench[t][limb].items():
                force = self.balance.maps[c, :3]
                columns += map(int, q[[0, 1, 3, 4]])
                parts.append(np.column_stack([force[:, :2], force[:, 3], -force[:, 3]]))
        matrix = np.hstack(parts)
        for axis in range(3):
            self.milp.row(columns, matrix[axis], -weight[axis], -weight[axis])

    def _moments(self, t: int) -> None:
        """(8b), at rest, about H's origin, a limb in the air half way between its contacts: no part of P2a."""
        balance, k = self.balance, self.windows.problem.patch.k_m
        columns, ends, parts, places = list[int](), list[int](), list[Array](), list[Array]()
        for limb in self.limbs:
            for c, q in self.wrench[t][limb].items():
                turn = balance.maps[c, 3:]
                columns += map(int, q[:5])
                parts.append(np.column_stack([turn[:, :2], k * turn[:, 2], turn[:, 3], -turn[:, 3]]))
            over = [(arc, column) for arc, column in self._limb_arcs(limb) if arc.first <= t < arc.end]
            ends += [*self.held[t][limb].values(), *(column for _, column in over)]
            places += [balance.centres[c] for c in self.held[t][limb]]
            places += [balance.mean_place((arc.start, arc.goal)) for arc, _ in over]
        body, shares = balance.weight(np.zeros(3))[0][3:], np.array([balance.weight(place)[1][3:] for place in places])
        for axis, row in enumerate(np.hstack(parts)):
            numbers = np.concatenate([row, body[axis], -shares[:, axis] / len(self.limbs)])
            self.milp.row([*columns, *map(int, self.body[t]), *ends], numbers, 0.0, 0.0)

    def _body_motion(self) -> None:
        windows, problem, milp = self.windows, self.windows.problem, self.milp
        step = problem.body.max_speed_m_s * problem.dt_s * windows.knots
        goal, slack = problem.goal.body.position_m, problem.goal.position_slack_m
        low, high = windows.body_range()
        for axis in range(3):
            first, last = int(self.body[0, axis]), int(self.body[-1, axis])
            milp.row([first], [1.0], problem.start.position_m[axis], problem.start.position_m[axis])
            milp.row([last], [1.0], goal[axis] - slack, goal[axis] + slack)
            for t in range(1, windows.count):
                milp.row([int(self.body[t, axis]), int(self.body[t - 1, axis])], [1.0, -1.0], -step, step)
            points = np.append(np.arange(low[axis], high[axis] + _TANGENT_STEP_M, _TANGENT_STEP_M), goal[axis])
            for t in range(windows.count):
                for d in points:
                    milp.row([int(self.body_squares[t, axis]), int(self.body[t, axis])], [1.0, -2 * d], -d * d, np.inf)

    def _cost(self, cost: WindowCost) -> Array:
        vector = np.zeros(self.milp.size)
        vector[self.body], vector[self.body_squares] = cost.body_linear, cost.body_square
        for t in range(self.windows.count):
            for limb in self.limbs:
                for c, held in self.held[t][limb].items():
                    vector[held] = cost.held[t, limb, c]
                    vector[self.wrench[t][limb][c]] = cost.linear[t, limb, c]
                    vector[self.squares[t][limb][c]] = cost.square[t]
        for columns, values in zip(self.arcs, cost.arcs, strict=True):
            vector[columns] = values
        return vector
