"""Limbs keep off each other and off the body: links, palms and fingers of one against those of another, along the whole
way.

Only what may be a violation, or the tightest place of all, is measured: boxes around the parts settle the rest.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from crux_contracts import LIMB_NAMES
from numpy.typing import NDArray

from crux_planner.checker import tolerances
from crux_planner.checker.clearance import NEAR_M
from crux_planner.checker.geometry import Array, box_to_box, segment_to_box, segment_to_segment, turned_back
from crux_planner.checker.parts import BLOCK, Part
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples

Indices = NDArray[np.int_]


def check_limb_clearance(samples: Samples, limbs: list[list[Part]], body: list[Part], findings: Findings) -> None:
    """Every part of every limb (in limb order) against those of all others, and of the body but what turns on it."""
    sides = [*combinations(limbs, 2), *(([part for part in limb if not part.on_body], body) for limb in limbs)]
    names = [*combinations(range(len(limbs)), 2), *((limb, None) for limb in range(len(limbs)))]
    groups = [(_Limb(first), _Limb(second)) for first, second in sides if first and second]
    pairs = [_Pair(first, second, _apart(first.extent, second.extent)) for first, second in groups]
    sure = max(0.0, tolerances.MOVING_CLEARANCE_M - tolerances.LENGTH_M)  # closer than this is a violation
    least = min((float(pair.far.min(initial=np.inf)) for pair in pairs), default=np.inf)
    for pair in pairs:
        least = min(least, float(pair.measured(*pair.middles()).min(initial=np.inf)))
    named = [name for name, (first, second) in zip(names, sides, strict=True) if first and second]
    for (first, second), pair in zip(named, pairs, strict=True):
        gap, closest = pair.gaps(max(least, sure))
        need = np.where(np.isfinite(gap), tolerances.MOVING_CLEARANCE_M - gap, -np.inf)
        what, worst = "", closest[int(np.argmax(need))]
        whose = "the body" if second is None else LIMB_NAMES[second]
        if worst >= 0:
            i, j = divmod(int(worst), len(pair.second.parts))
            part = "" if second is None else f"{pair.second.parts[j].kind} of "
            what = f"{pair.first.parts[i].kind} to {part}{whose}"
        findings.add_series("clearance_limbs", need, samples.time_s, "m", limb=first, detail=what or f"to {whose}")


@dataclass(frozen=True)
class _Limb:
    """The parts of a limb, and boxes around them: low and high corners."""

    parts: list[Part]

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """Of every part at every sample, (parts, 3, T)."""
        low, high = (np.array([part.corners[end] for part in self.parts]) for end in (0, 1))
        return low, high

    @cached_property
    def blocks(self) -> tuple[Array, Array]:
        """Of every part over some samples in a row, (parts, 3, blocks)."""
        low, high = (np.array([part.blocks[end] for part in self.parts]) for end in (0, 1))
        return low, high

    @cached_property
    def extent(self) -> tuple[Array, Array]:
        """Of the whole limb at every sample, (3, T)."""
        low, high = self.corners
        return np.fmin.reduce(low), np.fmax.reduce(high)

    @cached_property
    def is_box(self) -> NDArray[np.bool_]:
        """(parts,)"""
        return np.array([part.half_m is not None for part in self.parts], dtype=bool)


@dataclass(frozen=True)
class _Pair:
    """Two limbs; `apart_m` (T,) is a lower bound of their clearance, good enough where it is large."""

    first: _Limb
    second: _Limb
    apart_m: Array

    @property
    def far(self) -> Array:
        """The bounds that are good enough."""
        return self.apart_m[self.apart_m >= NEAR_M]

    def gaps(self, most: float) -> tuple[Array, Indices]:
        """Clearance (T,) where it is at most `most`, else infinite, and the parts: number of the first times how many
        the second limb has, plus number of the second; -1 where the bound is good enough.
        """
        gap = np.where((self.apart_m >= NEAR_M) & (self.apart_m <= most), self.apart_m, np.inf)
        closest = np.full(len(gap), -1)
        i, j, t = self._where(self._bounds <= most)
        (low, high), (their_low, their_high) = self.first.corners, self.second.corners
        apart = np.maximum(low[i, :, t] - their_high[j, :, t], their_low[j, :, t] - high[i, :, t])
        may = np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=1)) <= most + _ROUNDING_M
        i, j, t = i[may], j[may], t[may]
        found = self.measured(i, j, t)
        rank, other = (np.argsort(np.argsort(limb.is_box, kind="stable")) for limb in (self.first, self.second))
        order = np.lexsort((other[j], rank[i], found, t))  # of two as close, capsules before boxes
        order = order[np.append(True, np.diff(t[order]) > 0)] if len(order) > 0 else order
        order = order[np.isfinite(found[order])]
        gap[t[order]], closest[t[order]] = found[order], i[order] * len(self.second.parts) + j[order]
        return gap, closest

    def middles(self) -> tuple[Indices, Indices, Indices]:
        """Parts and samples: one sample of every block in which they may be close."""
        near = self.apart_m < NEAR_M
        i, j, block = np.nonzero(self._bounds < NEAR_M)
        t = np.minimum(block * BLOCK + BLOCK // 2, len(near) - 1)
        return i[near[t]], j[near[t]], t[near[t]]

    def measured(self, i: Indices, j: Indices, t: Indices) -> Array:
        """Exact clearance of parts i and j at samples t; infinite where one is nowhere."""
        found = np.full(len(t), np.inf)
        first, second = self.first.parts, self.second.parts
        boxes = self.first.is_box, self.second.is_box
        rows = np.flatnonzero(~boxes[0][i] & ~boxes[1][j])
        if len(rows) > 0:
            both = ((parts, of[rows], name) for parts, of in ((first, i), (second, j)) for name in ("start", "end"))
            ends = [_gathered(parts, name, of, t[rows]) for parts, of, name in both]
            radii = [np.array([p.radius_m for p in parts]) for parts in (first, second)]
            found[rows] = segment_to_segment(*ends) - (radii[0][i[rows]] + radii[1][j[rows]])
        for a in np.flatnonzero(boxes[0]):
            rows = np.flatnonzero((i == a) & ~boxes[1][j])
            found[rows] = _capsules_to_box(second, j[rows], t[rows], first[a])
        for b in np.flatnonzero(boxes[1]):
            rows = np.flatnonzero((j == b) & ~boxes[0][i])
            found[rows] = _capsules_to_box(first, i[rows], t[rows], second[b])
            for a in np.flatnonzero(boxes[0]):
                rows = np.flatnonzero((j == b) & (i == a))
                found[rows] = _box_to_box(first[a], second[b], t[rows])
        return np.where(np.isnan(found), np.inf, found)  # nowhere: reported as out of reach already

    @cached_property
    def _bounds(self) -> Array:
        """Lower bounds (first, second, blocks) of the clearance, from the boxes around the parts over some samples."""
        (low, high), (their_low, their_high) = self.first.blocks, self.second.blocks
        apart = np.maximum(low[:, None] - their_high, their_low - high[:, None])
        return np.asarray(np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=2)))

    def _where(self, blocks: NDArray[np.bool_]) -> tuple[Indices, Indices, Indices]:
        """Parts and samples of the blocks where the limbs are close."""
        i, j, block = np.nonzero(blocks)
        t = block[:, None] * BLOCK + np.arange(BLOCK)
        near = np.append(self.apart_m < NEAR_M, False)
        inside = near[np.minimum(t, len(self.apart_m))]
        return np.broadcast_to(i[:, None], t.shape)[inside], np.broadcast_to(j[:, None], t.shape)[inside], t[inside]


_ROUNDING_M = 1e-9


def _apart(extent: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Lower bound (T,) of the clearance of two limbs."""
    return np.asarray((np.maximum(extent[0], other[0]) - np.minimum(extent[1], other[1])).max(axis=0))


def _gathered(parts: list[Part], name: str, index: Indices, t: Indices) -> Array:
    """`start` or `end` (n, 3) of parts number `index` at samples t."""
    found = np.empty((3, len(t)))
    for number in np.unique(index):
        rows = np.flatnonzero(index == number)
        found[:, rows] = getattr(parts[number], name).T[:, t[rows]]
    return found.T


def _capsules_to_box(capsules: list[Part], index: Indices, t: Indices, box: Part) -> Array:
    """Clearance of parts number `index` at samples t to a box."""
    if box.half_m is None or box.rotation is None or len(t) == 0:
        return np.zeros(0)
    turn, centre = box.rotation[t], box.start[t]
    start, end = (turned_back(turn, _gathered(capsules, name, index, t) - centre) for name in ("start", "end"))
    return np.asarray(segment_to_box(start, end, box.half_m) - np.array([part.radius_m for part in capsules])[index])


def _box_to_box(a: Part, b: Part, t: Indices) -> Array:
    if a.half_m is None or b.half_m is None or a.rotation is None or b.rotation is None:
        return np.zeros(0)
    turn = b.rotation[t]
    between = turn.swapaxes(1, 2) @ a.rotation[t]
    return box_to_box(turned_back(turn, a.start[t] - b.start[t]), between, a.half_m, b.half_m)
