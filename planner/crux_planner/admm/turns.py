"""P3b for who is in the air: the shared copy is projected onto sequences in which limbs take turns.

Nothing in a limb's own block is in the way of another limb: by the other variables alone all of them would be in the
air together. So the binaries of who is away, window by window, are in the consensus of P3 too. In the copy the limbs'
swings, as many and as long as the limbs have them, come one after another, and a limb in the air pushes nowhere (10b);
of all such copies it is the nearest one, so that what the NLP has every limb bear decides with the limbs' own wishes
who waits. What a limb has and the copy has not goes into its dual, and makes it wait. Many sequences are as near as one
another: the one before stays until another is nearer by as much as they differ, else the copy goes to and fro.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import groupby

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.trajectory.consensus import Eta, Scales

Turn = tuple[int, int, int]
"""A limb is away from a window to one before another."""
_LEFT_OUT = 1e6  # price of a swing for which no window is left


def in_turn(copy: Eta, away: Array, before: Array, edges: Indices, rest: int, scales: Scales) -> Eta:
    """The nearest to `copy`, and to the flags `before`, in which the swings of `away` (T, L) take turns.

    Window t is knots edges[t] .. edges[t + 1] - 1; a swing leaves `rest` knots after its first window has begun.
    """
    knots, limbs = len(copy.forces), away.shape[1]
    forces, moments = (each.reshape(knots, limbs, -1).copy() for each in (copy.forces, copy.moments))
    pushes = scales.force**2 * (forces**2).sum(axis=2) + scales.moment**2 * (moments**2).sum(axis=2)
    wishes = scales.flag**2 * (1.0 - 2.0 * copy.away + (0.5 - before))

    def price(turn: Turn) -> float:
        limb, first, end = turn
        return float(wishes[first:end, limb].sum() + pushes[edges[first] + rest : edges[end], limb].sum())

    flags = np.zeros(away.shape)
    for limb, first, end in cheapest_turns([_lengths(column) for column in away.T], len(away), price):
        flags[first:end, limb] = 1.0
        forces[edges[first] + rest : edges[end], limb] = moments[edges[first] + rest : edges[end], limb] = 0.0
    return replace(
        copy, away=flags, forces=forces.reshape(copy.forces.shape), moments=moments.reshape(copy.moments.shape)
    )


def cheapest_turns(lengths: list[list[int]], count: int, price: Callable[[Turn], float]) -> list[Turn]:
    """Turns of each limb's swings, of so many windows each, in its order, not two at once; none in the first or the
    last of `count` windows, and a window between two of one limb. Where time is too short some are left out.
    """

    @cache
    def best(t: int, done: tuple[int, ...], last: int) -> tuple[float, tuple[Turn, ...]]:
        left = [own[many:] for own, many in zip(lengths, done, strict=True)]
        if t >= count - 1 or not any(left):
            return _LEFT_OUT * sum(map(len, left)), ()
        found = best(t + 1, done, -1)
        for limb, own in enumerate(left):
            if own and limb != last and t + own[0] <= count - 1:
                turn = (limb, t, t + own[0])
                more = (*done[:limb], done[limb] + 1, *done[limb + 1 :])
                cost, after = best(t + own[0], more, limb)
                if cost + price(turn) < found[0]:
                    found = cost + price(turn), (turn, *after)
        return found

    return list(best(1, (0,) * len(lengths), -1)[1])


def _lengths(away: Array) -> list[int]:
    """Windows of each swing of a limb (T,)."""
    return [len(list(run)) for on, run in groupby(away > 0.5) if on]
