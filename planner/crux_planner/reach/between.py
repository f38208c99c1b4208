"""Links of one limb against those of another."""

from __future__ import annotations

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.reach import native
from crux_planner.reach.solids import Links

_AT_ONCE = 4096  # poses, for the memory that all pairs of links take


def apart(first: Links, second: Links, clear_m: float, hands: bool = True) -> Flags:
    """(n,) where two limbs keep their links off each other by a clearance; without `hands`, those of one gripper off
    the other's are left out: no body pose changes how far these are apart. By numpy where the compiled one is missing.
    """
    compiled = native.library()
    if compiled is not None:
        return native.apart(compiled, first, second, clear_m, hands)
    some = (slice(at, at + _AT_ONCE) for at in range(0, max(len(first.start_m), 1), _AT_ONCE))
    return np.concatenate([gap_m(first, second, each, hands) >= clear_m for each in some])


def gap_m(first: Links, second: Links, some: Indices | slice = slice(None), hands: bool = True) -> Array:
    """Least distance (m,) between links of two limbs at some of the poses, negative where they are in each other; see
    `apart` about `hands`.
    """
    ends = [each[some] for each in (first.start_m, first.end_m, second.start_m, second.end_m)]
    pairs = segment_to_segment(ends[0][:, :, None], ends[1][:, :, None], ends[2][:, None], ends[3][:, None])
    gaps = pairs - first.radius_m[:, None] - second.radius_m
    if not hands:
        gaps[:, np.logical_and.outer(first.hand, second.hand)] = np.inf
    return np.asarray(gaps.min(axis=(1, 2)))


def segment_to_segment(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """Distance (...) of segments a0 to a1 and b0 to b1, points (..., 3) that broadcast. A point is a segment, too."""
    away = way_between(a0, a1, b0, b1)
    return np.asarray(np.sqrt((away * away).sum(axis=-1)))


def way_between(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """The shortest way (..., 3) from the second segment to the first."""
    u, v, off = a1 - a0, b1 - b0, a0 - b0
    uu, vv, uv = (u * u).sum(axis=-1), (v * v).sum(axis=-1), (u * v).sum(axis=-1)
    uo, vo = (u * off).sum(axis=-1), (v * off).sum(axis=-1)
    s = np.clip(_ratio(uv * vo - uo * vv, uu * vv - uv * uv), 0.0, 1.0)
    t = np.clip(_ratio(uv * s + vo, vv), 0.0, 1.0)
    s = np.clip(_ratio(uv * t - uo, uu), 0.0, 1.0)
    return np.asarray(off + s[..., None] * u - t[..., None] * v)


def _ratio(part: Array, whole: Array) -> Array:
    """0 where the whole is none: parallel segments, or points."""
    some = whole > 1e-15
    return np.asarray(np.where(some, part / np.where(some, whole, 1.0), 0.0))
