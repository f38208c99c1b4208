"""Limbs keep off each other: links, palms and fingers of one against those of another, along the whole way."""

from __future__ import annotations

import numpy as np
from crux_contracts import LIMB_NAMES
from numpy.typing import NDArray

from crux_planner.checker import tolerances
from crux_planner.checker.clearance import NEAR_M
from crux_planner.checker.geometry import Array, box_to_box, segment_to_box, segment_to_segment
from crux_planner.checker.parts import Part
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples


def check_limb_clearance(samples: Samples, parts: list[list[Part]], findings: Findings) -> None:
    """Every part of every limb (in limb order) against every part of every other one."""
    extents = [_extent(of_limb) for of_limb in parts]
    for first in range(len(parts)):
        for second in range(first + 1, len(parts)):
            low = np.maximum(extents[first][0], extents[second][0])
            high = np.minimum(extents[first][1], extents[second][1])
            apart = (low - high).max(axis=1)
            near = np.flatnonzero(apart < NEAR_M)
            gap, closest = apart.copy(), np.full(len(apart), -1)
            gap[near] = np.inf
            for of_first in _alike(parts[first]):
                for of_second in _alike(parts[second]):
                    found = _gaps([parts[first][i] for i in of_first], [parts[second][j] for j in of_second], near)
                    found = np.where(np.isnan(found), np.inf, found)  # nowhere: reported as out of reach already
                    for a, i in enumerate(of_first):
                        for b, j in enumerate(of_second):
                            closer = near[found[a, b] < gap[near]]
                            gap[near] = np.minimum(gap[near], found[a, b])
                            closest[closer] = i * len(parts[second]) + j
            need = np.where(np.isfinite(gap), tolerances.MOVING_CLEARANCE_M - gap, -np.inf)
            worst = closest[int(np.argmax(need))]
            what = ""
            if worst >= 0:
                i, j = divmod(int(worst), len(parts[second]))
                what = f"{parts[first][i].kind} to {parts[second][j].kind} of {LIMB_NAMES[second]}"
            findings.add_series(
                "clearance_limbs",
                need,
                samples.time_s,
                "m",
                tolerance=tolerances.LENGTH_M,
                limb=first,
                detail=what or f"to {LIMB_NAMES[second]}",
            )


def _extent(parts: list[Part]) -> tuple[Array, Array]:
    """Axis-aligned bounds (T, 3), (T, 3) of a limb."""
    low, high = [], []
    for part in parts:
        margin = part.radius_m if part.half_m is None else float(np.linalg.norm(part.half_m))
        low.append(np.minimum(part.start, part.end) - margin)
        high.append(np.maximum(part.start, part.end) + margin)
    return np.fmin.reduce(low), np.fmax.reduce(high)


def _alike(parts: list[Part]) -> list[list[int]]:
    """Numbers of the parts that are capsules, and of each box by itself."""
    capsules = [i for i, part in enumerate(parts) if part.half_m is None]
    boxes = [[i] for i, part in enumerate(parts) if part.half_m is not None]
    return [capsules, *boxes] if capsules else boxes


def _gaps(first: list[Part], second: list[Part], rows: NDArray[np.int_]) -> Array:
    """Clearance (A, B, n) of every part of one list, all capsules or one box, to every one of another at n samples."""
    a, b = first[0], second[0]
    if a.half_m is not None and b.half_m is None:
        return _gaps(second, first, rows).swapaxes(0, 1)
    if b.half_m is None or b.rotation is None:
        starts, ends = (np.stack([getattr(p, end)[rows] for p in first])[:, None] for end in ("start", "end"))
        others, their_ends = (np.stack([getattr(p, end)[rows] for p in second])[None] for end in ("start", "end"))
        radii = np.add.outer([p.radius_m for p in first], [p.radius_m for p in second])
        return np.asarray(segment_to_segment(starts, ends, others, their_ends) - radii[..., None])
    back = b.rotation[rows].swapaxes(1, 2)
    if a.half_m is not None and a.rotation is not None:
        centre = (back @ (a.start[rows] - b.start[rows])[..., None])[..., 0]
        return box_to_box(centre, back @ a.rotation[rows], a.half_m, b.half_m)[None, None]
    gaps = []
    for part in first:
        start = (back @ (part.start[rows] - b.start[rows])[..., None])[..., 0]
        end = (back @ (part.end[rows] - b.start[rows])[..., None])[..., 0]
        gaps.append(segment_to_box(start, end, b.half_m) - part.radius_m)
    return np.stack(gaps)[:, None]
