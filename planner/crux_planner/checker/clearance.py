"""(14), for the robot's real shapes and along the whole way: fingers, palms, links and body keep off holds, obstacles
and the wall.

Clearance is measured exactly for capsules against cuboids (the distance to a convex set is convex along a segment) and
by the separating axis theorem for boxes. Pads, which pass closest, are followed along the chords between samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, box_to_box, segment_to_box, signed_distance_to_box
from crux_planner.checker.parts import Part
from crux_planner.checker.plan_arrays import Cuboids
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples

NEAR_M = 0.03
"""Beyond this much clearance a lower bound of it is good enough."""

BLOCK = 32
"""Samples in a row that are looked at together, before each by itself."""


def check_clearance(
    samples: Samples,
    cuboids: Cuboids,
    limbs: list[list[Part]],
    body: list[Part],
    *,
    point_model: bool,
    findings: Findings,
) -> None:
    """Clearance of every part of the limbs (in limb order) and of the body to every cuboid and to the wall."""
    n_cuboids = len(cuboids.names)
    for index, parts in enumerate([*limbs, body]):
        limb = index if index < len(limbs) else None
        usual = np.full((len(samples.time_s), n_cuboids), tolerances.MOVING_CLEARANCE_M)
        for part in parts:
            required = _required(samples, limb, n_cuboids) if part.kind == "finger" and limb is not None else usual
            gaps = _gaps(part, cuboids)
            for c in range(n_cuboids):
                findings.add_series(
                    f"clearance_{part.kind}",
                    _or_nothing(required[:, c] - gaps[c]),
                    samples.time_s,
                    "m",
                    tolerance=tolerances.LENGTH_M,
                    limb=limb,
                    finger=part.finger,
                    detail=f"to {cuboids.names[c]!r}",
                )
            if point_model and part.kind in ("finger", "palm"):
                continue  # feet stand on the wall
            findings.add_series(
                "clearance_wall",
                _or_nothing(tolerances.MOVING_CLEARANCE_M - _height(part)),
                samples.time_s,
                "m",
                tolerance=tolerances.LENGTH_M,
                limb=limb,
                finger=part.finger,
                detail=f"of the {part.kind}",
            )


def _required(samples: Samples, limb: int, n_cuboids: int) -> Array:
    """Clearance (T, H) asked of a limb's fingers: none to the hold they grip, open on or close on."""
    required = np.full((len(samples.time_s), n_cuboids), tolerances.MOVING_CLEARANCE_M)
    own = samples.own_hold[:, limb]
    rows = np.flatnonzero(own >= 0)
    required[rows, own[rows]] = 0.0
    return required


def _or_nothing(amounts: Array) -> Array:
    """-inf, which is "does not apply", where a part is nowhere."""
    return np.where(np.isnan(amounts), -np.inf, amounts)


def _gaps(part: Part, cuboids: Cuboids) -> Array:
    """Clearance (H, T) of a part to every cuboid: exact where it is small, a lower bound elsewhere."""
    gaps, near = _far_off(part, cuboids)
    c, t = np.nonzero(near)
    half, rotation = 0.5 * cuboids.size_m[c], cuboids.rotation[c]
    start, end = _seen_from(part.start[t], cuboids, c, rotation), _seen_from(part.end[t], cuboids, c, rotation)
    if part.half_m is not None:
        reach: Array | float = float(np.linalg.norm(part.half_m))
    else:
        reach = 0.5 * np.linalg.norm(end - start, axis=1) + part.radius_m
    gap = np.asarray(signed_distance_to_box(0.5 * (start + end), half) - reach)
    close = np.flatnonzero(gap < NEAR_M)  # NaN (a pose out of reach) is not
    if len(close) > 0:
        fresh = part.moved[t[close]]
        fresh[0] = True
        fresh[1:] |= (np.diff(c[close]) != 0) | (np.diff(t[close]) != 1)
        rows = close[fresh]
        if part.half_m is not None and part.rotation is not None:
            turned = rotation[rows].swapaxes(1, 2) @ part.rotation[t[rows]]
            exact = box_to_box(start[rows], turned, part.half_m, half[rows])
        else:
            exact = segment_to_box(start[rows], end[rows], half[rows]) - part.radius_m
        gap[close] = exact[np.cumsum(fresh) - 1]
    gaps[c, t] = gap
    return gaps


def _far_off(part: Part, cuboids: Cuboids) -> tuple[Array, NDArray[np.bool_]]:
    """Lower bounds (H, T) of a part's clearance to every cuboid, from the box around it over some samples in a row, and
    where they are too small to settle anything. NaN where the part is nowhere.
    """
    margin = part.radius_m if part.half_m is None else float(np.linalg.norm(part.half_m))
    count = len(part.start)
    first = np.arange(0, count, BLOCK)
    low = np.fmin.reduceat(np.minimum(part.start, part.end), first, axis=0) - margin
    high = np.fmax.reduceat(np.maximum(part.start, part.end), first, axis=0) + margin
    reach = np.abs(cuboids.rotation) @ (0.5 * cuboids.size_m[..., None])  # of the cuboids along W's axes
    centre = cuboids.centre_w_m[:, None]
    apart = np.maximum(low - centre, centre - high) - reach.swapaxes(1, 2)  # (H, blocks, 3)
    bound = np.linalg.norm(np.maximum(apart, 0.0), axis=2)
    block = np.arange(count) // BLOCK
    bounds = bound[:, block]
    bounds[:, np.isnan(part.start).any(axis=1)] = np.nan
    return bounds, bounds < NEAR_M


def _seen_from(points: Array, cuboids: Cuboids, index: NDArray[np.int_], rotation: Array) -> Array:
    """Points (n, 3) in the frames of as many cuboids."""
    return np.asarray(((points - cuboids.centre_w_m[index])[:, None] @ rotation)[:, 0])


def _height(part: Part) -> Array:
    """Clearance (T,) above the wall plane z = 0."""
    if part.half_m is not None and part.rotation is not None:
        return part.start[:, 2] - np.abs(part.rotation[:, 2, :]) @ part.half_m
    return np.minimum(part.start[:, 2], part.end[:, 2]) - part.radius_m
