"""Where on a pair of faces pads bear best, and whether they bear wholly wherever a plan may have them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from crux_simulation.wall.places import PAIR_M, Indices, Places
from crux_simulation.wall.surface import Array

SAME_MERIT = 0.03  # merits that differ less are equal: by two of the rays that look at a pad
SHARE_DIGITS, ROUNDING = 2, 1e-9


@dataclass(frozen=True, eq=False)
class Line:
    """Places `which` (m,) in line along a pair of faces, all of a hold's places being `places`: how far along the faces
    (n,) [m] each place is, and how high (n,) the pads' middles are over its plane.
    """

    places: Places
    which: Indices
    along_m: Array
    pads_m: Array

    def of(self, which: Indices) -> Line:
        return Line(self.places, which, self.along_m, self.pads_m)

    @property
    def share(self) -> Array:
        """(m,) of the pad that bears less."""
        return np.asarray(self.places.coverage[self.which].min(axis=1))

    @property
    def lowest_m(self) -> float:
        return float(self.pads_m[self.which].min())

    @property
    def highest_m(self) -> float:
        return float(self.pads_m[self.which].max())

    @property
    def whole(self) -> Line:
        """Those with pads that bear wholly; all, where none does."""
        whole = self.which[self.share >= 1.0]
        return self.of(whole) if len(whole) else self

    def best(self, along_m: float, pads_m: float) -> int:
        """Of the places of the most merit the nearest to a spot."""
        merit = self.places.merit[self.which]
        good = self.which[merit >= merit.max() - SAME_MERIT]
        off = np.hypot(self.along_m[good] - along_m, self.pads_m[good] - pads_m)
        return int(good[off.argmin()])

    def ends(self, best: int, apart_m: float) -> list[int]:
        """Of the places as good as one, where as much of both pads bears, the farthest to both sides of it that are so
        far from it.
        """
        merit, coverage = self.places.merit[self.which], self.places.coverage[self.which]
        as_much = (coverage >= self.places.coverage[best] - ROUNDING).all(axis=1)
        good = self.which[as_much & (merit >= self.places.merit[best] - SAME_MERIT)]
        off = self.along_m[good] - self.along_m[best]
        return [int(good[end]) for end in (off.argmin(), off.argmax()) if abs(off[end]) >= apart_m]

    def bears_at(self, along_m: Iterable[float], pads_m: float) -> bool:
        """Whether there are places beside all of these spots with pads that bear wholly."""
        whole = self.which[self.share >= 1.0]
        off = (np.hypot(self.along_m[whole] - each, self.pads_m[whole] - pads_m) for each in along_m)
        return all((each < PAIR_M).any() for each in off)


def shares(places: Places, which: int, flipped: bool) -> tuple[float, float]:
    """What of the pads bears, rounded down, that at the end of a place's axis first, or last."""
    plus, minus = np.floor(places.coverage[which] * 10**SHARE_DIGITS + ROUNDING) / 10**SHARE_DIGITS
    return (float(minus), float(plus)) if flipped else (float(plus), float(minus))
