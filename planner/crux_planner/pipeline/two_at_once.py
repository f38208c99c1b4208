"""Two limbs at a time: moves of a sequence are made at once where two grips hold the body meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.schedule import Contacts, Move, Stance, stance_after
from crux_planner.pipeline.message import PlanResult
from crux_planner.search.event_cost import Timed
from crux_planner.swing.swing_cache import SwingCache

AHEAD = 3  # moves after one that may be made with it
MOST_REFUSED = 4  # pairs tried in vain: on a wall that is too steep for two grips all are


@dataclass
class TwoAtOnce:
    """Pairs the moves of one climb. `stands` says whether friction alone leaves the body a place on the grips of a
    move; `attempt` makes a checked plan of timed moves.
    """

    swings: SwingCache
    stands: Callable[[Move], bool]
    attempt: Callable[[Timed], PlanResult | int | None]

    def plan(self, timed: Timed) -> PlanResult | None:
        """A checked plan of the moves with as many as can be in pairs, the first ones first; None where none can."""
        found, refused = None, set[Contacts]()
        i = 0
        while i < len(timed.moves) - 1 and len(refused) < MOST_REFUSED:
            for j in range(i + 1, min(i + 1 + AHEAD, len(timed.moves))):
                both = paired(timed, i, j)
                if both is None or both.moves[i].held in refused or not self._may(both.moves[i:]):
                    continue
                made = self.attempt(both)
                if isinstance(made, PlanResult):
                    found, timed = made, both
                    break
                refused.add(both.moves[i].held)
            i += 1
        return found

    def _may(self, moves: list[Move]) -> bool:
        """Whether moves in a row, the first of which is new, have ways clear of all grippers, and grips to stand on."""
        ways = ([(m.before[limb], m.after[limb]) for limb in m.limbs] for m in moves)
        return self.stands(moves[0]) and all(self.swings.free(w, m.support) for w, m in zip(ways, moves, strict=True))


def paired(timed: Timed, i: int, j: int) -> Timed | None:
    """The sequence with move j made together with move i before it, in as long as the slower of them takes; None where
    a limb of theirs moves in between, or two limbs do already.
    """
    one, other = timed.moves[i], timed.moves[j]
    between = {limb for move in timed.moves[i:j] for limb in move.limbs}
    if len(one.limbs) + len(other.limbs) > 2 or between.intersection(other.limbs):
        return None
    limbs, ends = (*one.limbs, *other.limbs), (one.after[one.limbs[0]], other.after[other.limbs[0]])
    both = replace(one, after=stance_after(one.before, limbs, ends), limbs=limbs, touch_down=other.touch_down)
    moves, stance = [*timed.moves[:i], both], both.after
    for move in (each for k, each in enumerate(timed.moves[i + 1 :], i + 1) if k != j):
        moves.append(_from(stance, move))
        stance = moves[-1].after
    swings = timed.swings.copy()
    swings[i] = max(swings[i], swings[j])
    return Timed(moves, np.delete(timed.stances, j), np.delete(swings, j))


def _from(stance: Stance, move: Move) -> Move:
    """The same limbs to the same contacts, from another stance."""
    ends = tuple(move.after[limb] for limb in move.limbs)
    return replace(move, before=stance, after=stance_after(stance, move.limbs, ends))
