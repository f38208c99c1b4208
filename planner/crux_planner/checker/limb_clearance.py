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
            for i, a in enumerate(parts[first]):
                for j, b in enumerate(parts[second]):
                    found = _gap(a, b, near)
                    closer = near[found < gap[near]]
                    gap[near] = np.fmin(gap[near], found)
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


def _gap(a: Part, b: Part, rows: NDArray[np.int_]) -> Array:
    """Clearance of two parts at some samples."""
    if a.half_m is not None and a.rotation is not None and b.half_m is not None and b.rotation is not None:
        back = b.rotation[rows].swapaxes(1, 2)
        centre = (back @ (a.start[rows] - b.start[rows])[..., None])[..., 0]
        return box_to_box(centre, back @ a.rotation[rows], a.half_m, b.half_m)
    if a.half_m is not None:
        return _gap(b, a, rows)
    if b.half_m is not None and b.rotation is not None:
        back = b.rotation[rows].swapaxes(1, 2)
        start = (back @ (a.start[rows] - b.start[rows])[..., None])[..., 0]
        end = (back @ (a.end[rows] - b.start[rows])[..., None])[..., 0]
        return segment_to_box(start, end, b.half_m) - a.radius_m
    return segment_to_segment(a.start[rows], a.end[rows], b.start[rows], b.end[rows]) - a.radius_m - b.radius_m
