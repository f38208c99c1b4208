"""Limbs keep off each other and off the body: links, palms and fingers of one against those of another, along the whole
way.

Only what may be a violation, or the tightest place of all, is measured: boxes around the parts settle the rest.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.checker import geometry, tolerances
from crux_planner.checker.clearance import NEAR_M
from crux_planner.checker.geometry import Array, Flags, Indices, turned_back
from crux_planner.checker.parts import BLOCK, Part
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples


def check_limb_clearance(
    samples: Samples, limbs: list[list[Part]], body: list[Part], spare_m: float, findings: Findings
) -> None:
    """Every part of every limb (in limb order) against those of all others, and of the body but what turns on it;
    `spare_m`: asked for beside the usual clearance.
    """
    clear_m = tolerances.MOVING_CLEARANCE_M + spare_m
    whole, trunk = [_Limb(parts) for parts in limbs], _Limb(body)
    sides: list[tuple[int, int | None, _Pair]] = []
    for first, second in combinations(range(len(limbs)), 2):
        sides.append((first, second, _Pair(whole[first], whole[second])))
    for first, parts in enumerate(limbs):
        sides.append((first, None, _Pair(_Limb([part for part in parts if not part.on_body]), trunk)))
    sides = [side for side in sides if side[2].first.parts and side[2].second.parts]
    least, sure = np.inf, max(0.0, clear_m - tolerances.LENGTH_M)  # nearer: a violation
    for *_, pair in sides:
        near = pair.measured(*pair.middles())
        least = min(least, *(each.min(initial=np.inf) for each in (near, pair.apart_m[pair.apart_m >= NEAR_M])))
    for first, other, pair in sides:
        gap, closest = pair.gaps(max(least, sure))
        need = np.where(np.isfinite(gap), clear_m - gap, -np.inf)
        what, worst = "", closest[int(np.argmax(need))]
        whose = "the body" if other is None else LIMB_NAMES[other]
        if worst >= 0:
            i, j = divmod(int(worst), len(pair.second.parts))
            part = "" if other is None else f"{pair.second.parts[j].kind} of "
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
    def ends(self) -> Array:
        """Start and end of every part at every sample, (parts, 2, 3, T)."""
        return np.array([[part.start.T, part.end.T] for part in self.parts])

    @cached_property
    def radii_m(self) -> Array:
        """(parts,)"""
        return np.array([part.radius_m for part in self.parts])

    @cached_property
    def is_box(self) -> Flags:
        """(parts,)"""
        return np.array([part.half_m is not None for part in self.parts], dtype=bool)


@dataclass(frozen=True)
class _Pair:
    """Two limbs."""

    first: _Limb
    second: _Limb

    @cached_property
    def apart_m(self) -> Array:
        """Lower bound (T,) of the clearance, good enough where it is large."""
        (low, high), (their_low, their_high) = self.first.extent, self.second.extent
        return np.asarray((np.maximum(low, their_low) - np.minimum(high, their_high)).max(axis=0))

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
        found, first, second = np.full(len(t), np.inf), self.first, self.second
        rows = np.flatnonzero(~first.is_box[i] & ~second.is_box[j])
        if len(rows) > 0:
            ends = (limb.ends[of[rows], end, :, t[rows]] for limb, of in ((first, i), (second, j)) for end in (0, 1))
            found[rows] = geometry.segment_to_segment(*ends) - (first.radii_m[i[rows]] + second.radii_m[j[rows]])
        for a in np.flatnonzero(first.is_box):
            rows = np.flatnonzero((i == a) & ~second.is_box[j])
            found[rows] = _to_box(second, j[rows], t[rows], first.parts[a])
        for b in np.flatnonzero(second.is_box):
            rows = np.flatnonzero(j == b)
            found[rows] = _to_box(first, i[rows], t[rows], second.parts[b])
        return np.where(np.isnan(found), np.inf, found)  # nowhere: reported as out of reach already

    @cached_property
    def _bounds(self) -> Array:
        """Lower bounds (first, second, blocks) of the clearance, from the boxes around the parts over some samples."""
        (low, high), (their_low, their_high) = self.first.blocks, self.second.blocks
        apart = np.maximum(low[:, None] - their_high, their_low - high[:, None])
        return np.asarray(np.sqrt((np.maximum(apart, 0.0) ** 2).sum(axis=2)))

    def _where(self, blocks: Flags) -> tuple[Indices, Indices, Indices]:
        """Parts and samples of the blocks where the limbs are close."""
        i, j, block = np.nonzero(blocks)
        t = block[:, None] * BLOCK + np.arange(BLOCK)
        near = np.append(self.apart_m < NEAR_M, False)
        inside = near[np.minimum(t, len(self.apart_m))]
        return np.broadcast_to(i[:, None], t.shape)[inside], np.broadcast_to(j[:, None], t.shape)[inside], t[inside]


_ROUNDING_M = 1e-9


def _to_box(limb: _Limb, index: Indices, t: Indices, box: Part) -> Array:
    """Clearance of a limb's parts number `index` at samples t to a box."""
    if box.half_m is None or box.rotation is None or len(t) == 0:
        return np.zeros(0)
    turn, centre = box.rotation[t], box.start[t]
    start, end = (turned_back(turn, limb.ends[index, which, :, t] - centre) for which in (0, 1))
    found = geometry.segment_to_box(start, end, box.half_m) - limb.radii_m[index]
    for number, part in enumerate(limb.parts):
        if part.half_m is not None and part.rotation is not None:
            rows = np.flatnonzero(index == number)
            between = turn[rows].swapaxes(1, 2) @ part.rotation[t[rows]]
            found[rows] = geometry.box_to_box(start[rows], between, part.half_m, box.half_m)
    return found
