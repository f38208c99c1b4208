"""What the plan asked for at each moment of a run, told from what happened in physics (msgs/PLAN.md, the plan's clock).

The clock runs while the runtime climbs, which the simulation hears on the bus. It waits before a knot at which a limb
releases until the fingers have left, and before one at which a limb takes hold until they touch; fingers that leave
within the interval before their knot set it there. So it follows the runtime's clock to within the time that fingers
need to open and to close, and no error adds up. An operator's speed it does not know: it leads a slower climb until the
next contact. Where a grasp just made is opened again, to be made anew, it goes back to before it. In reverse it runs
back, and what takes hold and what releases change places. A walk waits for nothing.
"""

from __future__ import annotations

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import PlanReference
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAD_INTERVALS = 3  # that a pull on a new grasp, at most, puts between the clocks
FULL = 1.0  # of PlanReference.load: neither in the air, nor unloading before, nor loading after


class ReferenceClock:
    """Plays a plan along a run."""

    def __init__(self, reference: PlanReference) -> None:
        self._reference = reference
        limbs, knots = range(len(LIMB_NAMES)), range(reference.intervals + 1)
        waits = not reference.point_feet
        self._leaving = [[limb for limb in limbs if waits and reference.lets_go(k, limb)] for k in knots]
        self._arriving = [[limb for limb in limbs if waits and reference.takes_hold(k, limb)] for k in knots]
        self._interval = 0
        self._elapsed_s = 0.0
        self._turned = False

    def _end(self, interval: int) -> None:
        """Stands at the end of an interval."""
        self._interval, self._elapsed_s = interval, float(self._reference.step_s[interval])

    def _set_by_releases(self, back: bool, off: Bools) -> None:
        """The pull on a new grasp, for which the clock does not wait, makes it lead, and lag behind once it is turned
        round: what releases near by sets it."""
        last = self._reference.intervals
        if back:
            for knot in range(self._interval - 1, max(self._interval - LEAD_INTERVALS, 0), -1):
                if np.any(off[self._arriving[knot]]):
                    self._interval, self._elapsed_s = knot, 0.0
        else:
            for knot in range(self._interval + 2, min(self._interval + LEAD_INTERVALS + 1, last)):
                if np.any(off[self._leaving[knot]]):
                    self._end(knot - 1)

    def _set_by_openings(self, back: bool, opened: Bools) -> None:
        """What opens again soon after it has taken hold, and is not due to leave, tries its grasp anew."""
        here, step = self._interval, 1 if back else -1
        arriving, leaving = (self._leaving, self._arriving) if back else (self._arriving, self._leaving)
        for knot in range(here + (1 if back else 0), here + (1 + LEAD_INTERVALS if back else -LEAD_INTERVALS), step):
            if not 0 < knot < self._reference.intervals:
                return
            due = {limb for k in range(min(knot, here), max(knot, here + 1) + 1) for limb in leaving[k]}
            if any(opened[limb] and limb not in due for limb in arriving[knot]):
                if back:
                    self._interval, self._elapsed_s = knot, 0.0
                else:
                    self._end(knot - 1)
                return

    def advance(self, dt_s: float, off: Bools, opened: Bools) -> None:
        """Moves on by `dt_s` (negative: back), or up to the next knot that is not due; `off` (4,): limbs that have left
        their holds; `opened` (4,): with fingers further apart than on them."""
        back = dt_s < 0
        self._set_by_openings(back, opened)
        self._turned = self._turned or back
        if self._turned:
            self._set_by_releases(back, off)
        length_s = self._reference.step_s[self._interval]
        if back:
            knot, leaving, arriving = self._interval, self._arriving, self._leaving
        else:
            knot, leaving, arriving = self._interval + 1, self._leaving, self._arriving
        self._elapsed_s += dt_s
        if knot in (0, self._reference.intervals):
            self._elapsed_s = min(max(self._elapsed_s, 0.0), length_s)
            return
        edge_s = 0.0 if back else length_s
        if np.any(off[leaving[knot]]):
            self._elapsed_s = min(self._elapsed_s, edge_s) if back else max(self._elapsed_s, edge_s)
        if self._elapsed_s > edge_s if back else self._elapsed_s < edge_s:
            return
        if np.all(off[leaving[knot]]) and not np.any(off[arriving[knot]]):
            self._interval += -1 if back else 1
            self._elapsed_s += self._reference.step_s[self._interval] if back else -length_s
        else:
            self._elapsed_s = edge_s

    def play(self, step_s: Floats, off: Bools, opened: Bools) -> tuple[Floats, Bools]:
        """Plan time (n,) and whether each limb is in stance under its whole load (n, 4) at the end of each step.

        `step_s` (n,): how long the runtime climbed in the step, negative where it did so in reverse; `off` (n, 4):
        limbs that are off their holds for good, not only for the moment that a finger chatters; `opened` (n, 4): those
        of them whose fingers stand further apart than on the hold before.
        """
        intervals, elapsed_s = np.zeros(len(step_s), dtype=np.int64), np.zeros(len(step_s))
        for i, (dt_s, *limbs) in enumerate(zip(step_s.tolist(), off, opened, strict=True)):
            if dt_s:
                self.advance(dt_s, *limbs)
            intervals[i], elapsed_s[i] = self._interval, self._elapsed_s
        stance = np.zeros(off.shape, dtype=bool)
        share = elapsed_s / self._reference.step_s[intervals]
        for k in np.unique(intervals).tolist():
            rows = np.flatnonzero(intervals == k)
            for limb in range(len(LIMB_NAMES)):
                stance[rows, limb] = self._reference.load(limb, k, share[rows]) >= FULL
        return self._reference.time_s[intervals] + elapsed_s, stance
