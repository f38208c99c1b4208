"""Whether another sequence of as many moves, or one fewer, is cheaper than the search's, by a mixed-integer program.

The program (certificates.stance_mip) proposes what is cheapest from below, the search's estimate of J judges it, and it
is left out, until what is left costs no less than the search's sequence does by the same program, or the work is done.
"""

from dataclasses import dataclass

import numpy as np

from crux_planner.certificates.stance_mip import Loads, Sequence, StanceMip, Swing
from crux_planner.model.arrays import Array
from crux_planner.physics.reachable_set import goal_contacts
from crux_planner.search.event_cost import EventCost, Timed
from crux_planner.search.improve import Steps, improve, retimed
from crux_planner.solvers import clock

MOST_MOVES = 8  # of a sequence that is looked at: the program grows with their square
GAP = 0.03  # of the cost: no sequence that is cheaper by less is looked for
_NEAR = 4  # contacts a limb may go to beside each that the search's sequence has
_ROUNDS = 4  # of cuts before the first proposal
_WORK = 1_500_000  # of the simplex method (solvers.milp), after which there is no further proposal
_NODES = 200  # of the tree of one proposal
_LARGE = 300_000  # work on the program without integers beyond which it is too large for proposals
_CONVERGED = 1e-4  # of the cost, what a round of cuts may still add
_RETIMING = 20_000  # work of EventCost on a better sequence's times


@dataclass(frozen=True)
class OtherSequences:
    """What the program says of a sequence: the cheapest known, whether the program found it, and what it proved."""

    timed: Timed
    moves: tuple[int, ...]  # of the sequences compared with the search's
    found: bool
    least: float  # share of the cost of the search's sequence below which no other is that was not judged, see `scope`
    judged: int
    steps: int  # that all of them may take

    @property
    def scope(self) -> str:
        """What `least` is about."""
        return f"{' or '.join(map(str, self.moves))} moves in up to {self.steps} steps over contacts near the search's"

    def __str__(self) -> str:
        by = "a MIP (cheaper than the search's, by estimates)" if self.found else "the search"
        none = f"HiGHS found no sequence of {self.scope} that costs less than {100 * self.least:.0f} % of the search's"
        return f"contacts from {by}; {none} ({self.judged} candidates evaluated individually)"

    def to_json(self) -> dict[str, object]:
        """Of `crux plan --json`."""
        by = "mip" if self.found else "search"
        return {"found_by": by, "others_at_least": self.least, "estimated": self.judged, "scope": self.scope}


def look_at_others(costs: EventCost, timed: Timed, deadline: float) -> OtherSequences | None:
    """None where the moves are too many or not single, where the program has no place for them, or after `deadline`
    (of clock.now).
    """
    moves = timed.moves
    single = 0 < len(moves) <= MOST_MOVES and all(len(move.limbs) == 1 for move in moves)
    if not single or clock.now() > deadline:
        return None
    own = tuple((move.limbs[0], (move.before[move.limbs[0]], move.after[move.limbs[0]])) for move in moves)
    loads = Loads(costs)
    alone = StanceMip(costs, loads, len(moves), [sorted({s for at, s in own if at == limb}) for limb in range(4)])
    alone.fix(own)
    value, multipliers = _converged(alone)
    if value <= 0.0 or not np.isfinite(value):
        return None
    judge = _Judge(costs, timed, value, deadline)
    for count in (len(moves) - 1, len(moves)):
        if (swings := _swings(costs, own, count)) is None:
            continue
        program = StanceMip(costs, loads, count, swings)
        if count == len(moves):
            program.leave_out(own)
        for several in multipliers:
            program.carry(several)
        judge.run(program, count)
    return judge.verdict()


def _converged(program: StanceMip) -> tuple[float, list[Array]]:
    """The cost of a program without integers, and the multipliers that its last rounds of cuts are of."""
    value, multipliers = -np.inf, []
    for _ in range(3 * _ROUNDS):
        relaxed = program.solve(relaxed=True)
        if relaxed.values is None:
            return np.inf, []
        if relaxed.objective - value < _CONVERGED * abs(value):
            break
        value = relaxed.objective
        multipliers = program.cut(relaxed.values, _CONVERGED * abs(value))
    return value, multipliers


class _Judge:
    def __init__(self, costs: EventCost, timed: Timed, value: float, deadline: float) -> None:
        self.costs, self.best, self.value, self.deadline = costs, timed, value, deadline
        self.steps = timed.knots
        estimate = costs.estimate(timed)
        self.cost = np.inf if estimate is None else estimate.cost
        self.found, self.judged, self.least = False, 0, 1.0
        self.moves: list[int] = []

    def run(self, program: StanceMip, moves: int) -> None:
        """Proposals of so many moves until none is worth it."""
        self.moves.append(moves)
        worth = _CONVERGED * self.value
        for _ in range(_ROUNDS):
            relaxed = program.solve(relaxed=True)
            if relaxed.values is None:
                self.least = self.least if relaxed.infeasible else 0.0  # HiGHS finds no other, or knows of none
                return
            program.cut(relaxed.values, worth)
        bound, work = relaxed.objective, 0 if relaxed.work < _LARGE else _WORK
        while work < _WORK:
            proposed = program.solve(gap=GAP / 2, nodes=_NODES, time_limit_s=self.deadline - clock.now())
            work += proposed.work
            bound = np.inf if proposed.infeasible else max(bound, proposed.bound)
            if proposed.values is None or bound >= (1.0 - GAP) * self.value or clock.now() > self.deadline:
                break
            program.cut(proposed.values, worth)
            self._judge(program, program.sequence(proposed.values))
        self.least = max(0.0, min(self.least, bound / self.value))

    def _judge(self, program: StanceMip, sequence: Sequence) -> None:
        """Keeps a sequence that is better by the search's estimate; it does not come again."""
        self.judged += 1
        program.leave_out(sequence)
        stance = list(self.costs.problem.start_contacts)
        for limb, swing in sequence:
            for other, contact in enumerate(stance):
                if other != limb and not self.costs.swings.free([swing], (contact,)):
                    program.keep_apart(limb, swing, other, contact)
            stance[limb] = swing[1]
        steps: Steps = tuple(((limb,), (swing[1],)) for limb, swing in sequence)
        timed = retimed(self.costs, steps, self.best)
        estimate = None if timed is None else self.costs.estimate(timed)
        if timed is not None and estimate is not None and estimate.cost < (1.0 - GAP) * self.cost:
            self.best, self.cost, self.found = timed, estimate.cost, True

    def verdict(self) -> OtherSequences:
        """What is known in the end."""
        timed = self.best
        if self.found:
            timed = improve(self.costs, timed.moves, self.deadline, self.costs.work + _RETIMING, self.steps) or timed
        return OtherSequences(timed, tuple(self.moves), self.found, self.least, self.judged, self.steps)


def _swings(costs: EventCost, sequence: Sequence, moves: int) -> list[list[Swing]] | None:
    """The swings of each limb among contacts near its own that leave the others' limbs moves enough; None where so many
    do not lead to the goal.
    """
    every = [_among(costs, limb, [s for at, s in sequence if at == limb]) for limb in range(4)]
    starts, ends = [{c} for c in costs.problem.start_contacts], goal_contacts(costs.problem, costs.reach)
    since = [_moves_from(set(start), own) for start, own in zip(starts, every, strict=True)]
    ahead = [_moves_from(set(end), [(b, a) for a, b in own]) for end, own in zip(ends, every, strict=True)]
    least = [to_go[c] for to_go, c in zip(ahead, costs.problem.start_contacts, strict=True)]
    spare = moves - sum(least)
    if moves == 0 or spare < 0:
        return None
    return [
        [(a, b) for a, b in own if a in begun and b in to_go and begun[a] + 1 + to_go[b] <= few + spare]
        for own, begun, to_go, few in zip(every, since, ahead, least, strict=True)
    ]


def _among(costs: EventCost, limb: int, own: list[Swing]) -> list[Swing]:
    problem, reach = costs.problem, costs.reach
    usable = set(reach.usable[limb])
    near = {problem.start_contacts[limb], *(end for _, end in own)}
    for contact in sorted(near):
        place = problem.contacts[contact].centre_h_m
        others = sorted(
            (int(c) for c in reach.neighbours(limb, contact) if int(c) in usable),
            key=lambda c: float(np.abs(problem.contacts[c].centre_h_m - place).sum()),
        )
        near.update(others[: _NEAR + 1])  # itself too
    pairs = ((a, int(b)) for a in near for b in reach.neighbours(limb, a) if b in near and b in usable)
    return sorted({*own, *((a, b) for a, b in pairs if a != b and costs.swings.swing(a, b) is not None)})


def _moves_from(contacts: set[int], swings: list[Swing]) -> dict[int, int]:
    """Least moves to each contact."""
    moves = dict.fromkeys(contacts, 0)
    new = contacts
    while new:
        new = {b for a, b in swings if a in new} - set(moves)
        moves |= dict.fromkeys(new, max(moves.values(), default=0) + 1)
    return moves
