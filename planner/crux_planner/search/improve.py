"""Local search on J (6): the order of the moves, the contacts they go to, and when each happens.

The search for contacts finds the quickest sequence; this one looks for a cheaper one near it. A neighbour moves one
step elsewhere in the order, sends a limb to another contact or straight to its next one, or shifts knots between
stances and swings. Each is judged by `EventCost` with the body as it is but about what changes, so that one costs no
more on a long wall; the whole path is chosen anew when no neighbour is better. The work is counted, so that it is the
same every time.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.schedule import Move, Stance, stance_after
from crux_planner.physics.reachable_set import goal_contacts
from crux_planner.search.event_cost import Estimate, EventCost, Timed
from crux_planner.solvers import clock

WORK = 80_000  # of EventCost, at most
_LEAST_GAIN = 2e-4  # of J, as a share of it
_UNSURE = 0.02  # of J, by which estimates may be wrong
_FARTHEST = 5  # places by which a step moves in the order
_OTHERS = 3  # contacts tried instead of one
_LAST_STANCE = 2  # knots at least
_STARTS = 12  # stances tried that take all spare time

Steps = tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
"""The limbs of each move and the contacts they go to."""


@dataclass(frozen=True)
class _Best:
    steps: Steps
    timed: Timed
    estimate: Estimate


def improve(
    costs: EventCost, moves: list[Move], deadline: float, work: int = WORK, steps: int | None = None
) -> Timed | None:
    """Timed moves of lower J over `steps` knots, the problem's unless told; None where even the moves given leave no
    body path with all spare time in one stance.

    It ends after so much `work` and at `deadline` (of clock.now).
    """
    return _Improvement(costs, deadline, work, steps or costs.problem.steps).run(moves)


def improve_in_fewest(costs: EventCost, quickest: Timed, deadline: float) -> tuple[Timed | None, bool]:
    """Timed moves of low J (6) over as many knots as make it least, since J sums over them; and whether the `quickest`
    are as cheap, for all that the estimates say.

    The moves as they are, and as they are best over all of the problem's knots, are improved over as few as they may
    take, then over one more each time, for as long as that is cheaper.
    """
    most, until = costs.problem.steps, costs.work + WORK
    fits = quickest.knots <= most
    over_all = improve(costs, quickest.moves, deadline, until, most)
    starts = [quickest.moves, *([] if over_all is None else [over_all.moves])]
    best, least = over_all, np.inf
    for moves in starts if fits else starts[1:]:
        last = np.inf
        fewest = least_knots(costs, moves)
        if not _Improvement(costs, deadline, until, fewest).somewhere(moves):
            continue
        for steps in range(fewest, most + 1):
            timed = improve(costs, moves, deadline, until, steps)
            if timed is None:
                continue
            estimate = costs.estimate(timed)
            if estimate is None or estimate.cost >= last:
                break
            last = estimate.cost
            if last < least:
                best, least = timed, last
    plain = costs.estimate(quickest) if fits else None
    return best, plain is not None and plain.cost < (1.0 + _UNSURE) * least and not quickest.same(best)


def least_knots(costs: EventCost, moves: list[Move]) -> int:
    """Knots that moves take if the body has none to wait for."""
    return costs.problem.steps - _Improvement(costs, np.inf, 0, costs.problem.steps).spare(moves)


def retimed(costs: EventCost, steps: Steps, before: Timed) -> Timed | None:
    """Other steps, with the stances of others as far as they fit; None where a way, a reach, time or the goal lacks."""
    among = _Improvement(costs, np.inf, 0, before.knots)
    moves = among.moves(steps)
    return None if moves is None else among.as_before(moves, before)


Neighbours = Callable[[_Best], Iterator[tuple[Steps, Timed]]]


class _Improvement:
    def __init__(self, costs: EventCost, deadline: float, work: int, steps: int) -> None:
        self.costs, self.deadline, self.work, self.knots = costs, deadline, work, steps
        self.problem, self.reach, self.swings = costs.problem, costs.reach, costs.swings
        self.ends = [set(ends) for ends in goal_contacts(self.problem, self.reach)]
        self.tried: set[tuple[Steps, bytes]] = set()
        self.known: dict[tuple[Stance, tuple[tuple[int, ...], tuple[int, ...]]], Move | None] = {}
        self.least_gain = 0.0
        self.place = 0  # the step at which the last neighbour was found: the next are looked for from there on

    def run(self, moves: list[Move]) -> Timed | None:
        steps: Steps = tuple((move.limbs, tuple(move.after[limb] for limb in move.limbs)) for move in moves)
        best = self._first(steps)
        if best is None:
            return None
        self.least_gain = _LEAST_GAIN * abs(best.estimate.cost)
        improved = True
        while improved and not self._over():
            best, in_order = self._climb(best, self._other_steps)
            best, in_time = self._climb(best, self._other_times)
            improved = in_order and in_time
            if not improved:
                best, improved = self._climb(best, self._others_anew)
            best = self._as_a_whole(best)
        places = best.estimate.places
        timed = [replace(m, lift_off=p[0], touch_down=p[1]) for m, p in zip(best.timed.moves, places, strict=True)]
        return replace(best.timed, moves=timed)

    def _over(self) -> bool:
        return self.costs.work >= self.work or self._late()

    def _late(self) -> bool:
        return clock.now() > self.deadline

    def _as_a_whole(self, best: _Best) -> _Best:
        """The same with the whole path of the body chosen at once."""
        whole = self.costs.estimate(best.timed)
        return best if whole is None or whole.cost > best.estimate.cost else replace(best, estimate=whole)

    def _first(self, steps: Steps) -> _Best | None:
        """The steps with all spare time in one stance: the best of those that promise most, by where waiting is cheap.

        On a long way a stance far from the goal costs most, so few of them are worth an estimate.
        """
        moves = self.moves(steps)
        if moves is None or not self.somewhere(moves):
            return None
        found: list[_Best] = []
        promising = list(range(len(steps), -1, -1))  # the last first
        while promising and len(found) < _STARTS and not (found and self._late()):
            timed = self._quick(moves, promising.pop(0))
            estimate = None if timed is None else self.costs.estimate(timed, found[0].estimate if found else None)
            if timed is None or estimate is None:
                continue
            found.append(_Best(steps, timed, estimate))
            if len(found) == 1:
                waiting = self.costs.waiting_costs(timed, estimate)
                promising.sort(key=lambda where: waiting[where])
        return min(found, key=lambda best: best.estimate.cost, default=None)

    def _climb(self, best: _Best, neighbours: Neighbours) -> tuple[_Best, bool]:
        """Takes neighbours as long as some are better; whether one was."""
        better = True
        ever = False
        while better and not self._over():
            better = False
            for steps, timed in neighbours(best):
                key = (steps, np.concatenate([timed.stances, timed.swings]).tobytes())
                if key in self.tried:
                    continue
                self.tried.add(key)
                estimate = self.costs.estimate(timed, best.estimate)
                if estimate is not None and estimate.cost < best.estimate.cost - self.least_gain:
                    best, better, ever = _Best(steps, timed, estimate), True, True
                    break
                if self._over():
                    break
        return best, ever

    def _other_steps(self, best: _Best) -> Iterator[tuple[Steps, Timed]]:
        for steps in self._rearranged(best.steps):
            moves = self.moves(steps)
            timed = None if moves is None else self.as_before(moves, best.timed)
            if timed is not None:
                yield steps, timed

    def _others_anew(self, best: _Best) -> Iterator[tuple[Steps, Timed]]:
        """Other steps, which may be worth it with the spare time at the start or at the end."""
        for steps in self._rearranged(best.steps):
            moves = self.moves(steps)
            for where in (len(steps), 0) if moves is not None else ():
                timed = self._quick(moves or [], where)
                if timed is not None:
                    yield steps, timed

    def _rearranged(self, steps: Steps) -> Iterator[Steps]:
        count = len(steps)
        order = [(self.place + i) % count for i in range(count)]
        for i in order:
            self.place = i
            for j in range(i + 1, count):  # straight to where the limb goes next
                if steps[i][0] == steps[j][0]:
                    yield (*steps[:i], steps[j], *steps[i + 1 : j], *steps[j + 1 :])
                    yield steps[:i] + steps[i + 1 :]
                    break
        for by in range(1, _FARTHEST + 1):
            for i in order:
                self.place = i
                for j in (i + by, i - by) if by > 1 else (i + by,):
                    if 0 <= j < count:
                        rest = steps[:i] + steps[i + 1 :]
                        yield (*rest[:j], steps[i], *rest[j:])
        for i in order:
            self.place = i
            limbs, ends = steps[i]
            if len(limbs) > 1:
                continue
            last = not any(limbs[0] in later for later, _ in steps[i + 1 :])
            for other in self._others(limbs[0], ends[0], last):
                yield (*steps[:i], (limbs, (other,)), *steps[i + 1 :])

    def _others(self, limb: int, contact: int, last: bool) -> list[int]:
        contacts = self.problem.contacts
        usable = self.ends[limb] if last else set(self.reach.usable[limb])
        place = contacts[contact].centre_h_m
        found = [int(c) for c in self.reach.neighbours(limb, contact) if int(c) in usable and c != contact]
        return sorted(found, key=lambda c: float(np.abs(contacts[c].centre_h_m - place).sum()))[:_OTHERS]

    def moves(self, steps: Steps) -> list[Move] | None:
        """The steps as moves, None where a way, a reach or the goal is missing."""
        stance: Stance = self.problem.start_contacts
        moves = []
        for step in steps:
            if (key := (stance, step)) not in self.known:
                self.known[key] = self._move(stance, *step)
            if (move := self.known[key]) is None:
                return None
            moves.append(move)
            stance = move.after
        ends = all(c in ends for c, ends in zip(stance, self.ends, strict=True)) and self.reach.may_end(stance)
        return moves if ends else None

    def _move(self, stance: Stance, limbs: tuple[int, ...], ends: tuple[int, ...]) -> Move | None:
        after, nowhere = stance_after(stance, limbs, ends), np.zeros(3)
        move = Move(stance, after, limbs, nowhere, nowhere)
        swings = [(stance[limb], after[limb]) for limb in limbs]
        if any(start == end for start, end in swings) or self.reach.of(after) is None:
            return None
        return move if self.swings.free(swings, move.support) else None

    def _least(self, moves: list[Move]) -> tuple[Array, Array, int]:
        """Least knots of stances and swings, and the knots to spare."""
        stances = np.ones(len(moves) + 1, dtype=int)
        stances[-1] = _LAST_STANCE
        swings = [max(self.swings.intervals(m.before[limb], m.after[limb]) for limb in m.limbs) for m in moves]
        return stances, np.array(swings, dtype=int), self.knots - int(stances.sum()) - sum(swings)

    def spare(self, moves: list[Move]) -> int:
        """Knots beyond those that swings and stances take."""
        return self._least(moves)[2]

    def somewhere(self, moves: list[Move]) -> bool:
        """Whether the body has a place at each event, which does not depend on how long stances are."""
        timed = self._quick(moves, 0)
        return timed is None or self.costs.has_places(timed)

    def _quick(self, moves: list[Move], where: int) -> Timed | None:
        """As quick as can be, all spare time in stance `where`."""
        stances, swings, spare = self._least(moves)
        if spare < 0:
            return None
        stances[where] += spare
        return Timed(moves, stances, swings)

    def as_before(self, moves: list[Move], before: Timed) -> Timed | None:
        """Moves with the stances of others as far as they fit."""
        longest = int(np.argmax(before.stances))
        stances, swings, spare = self._least(moves)
        if len(moves) != len(before.moves):
            return self._quick(moves, min(longest, len(moves)))
        more = before.stances - stances
        more[longest] += spare - int(more.sum())
        return Timed(moves, stances + more, swings) if spare >= 0 and more[longest] >= 0 else None

    def _other_times(self, best: _Best) -> Iterator[tuple[Steps, Timed]]:
        """Knots shifted between stances, and into or out of swings where J may gain by it."""
        stances, swings = best.timed.stances, best.timed.swings
        least, quickest, _ = self._least(best.timed.moves)
        slack = stances - least
        longest = int(np.argmax(slack))
        spare = int(slack[longest])
        others = [where for where in range(len(stances)) if where != longest]
        for knots in dict.fromkeys((spare, 2, 1)):
            for where in others:
                if 0 < knots <= spare:
                    yield best.steps, replace(best.timed, stances=_shifted(stances, longest, where, knots))
                if knots <= slack[where]:
                    yield best.steps, replace(best.timed, stances=_shifted(stances, where, longest, knots))
        for knots in dict.fromkeys((spare, spare // 4, 1)):
            for i, worth in enumerate(best.estimate.air_costs):
                more = min(knots, spare) if worth < 0.0 else -min(knots, int(swings[i] - quickest[i]))
                if more:
                    times = swings.copy()
                    times[i] += more
                    shorter = stances.copy()
                    shorter[longest] -= more
                    yield best.steps, replace(best.timed, stances=shorter, swings=times)


def _shifted(stances: Array, a: int, b: int, knots: int) -> Array:
    changed = stances.copy()
    changed[a] -= knots
    changed[b] += knots
    return changed
