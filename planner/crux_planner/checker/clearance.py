"""(14), for the robot's real shapes and along the whole way: fingers, palms, links and body keep off holds, obstacles
and the wall.

Clearance is measured exactly for capsules against cuboids (the distance to a convex set is convex along a segment) and
by the separating axis theorem for boxes. Pads, which pass closest, are followed along the chords between samples.
"""

from __future__ import annotations

import numpy as np

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, box_to_box, segment_to_box, signed_distance_to_box
from crux_planner.checker.parts import Part
from crux_planner.checker.plan_arrays import Cuboids
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples

NEAR_M = 0.03
"""Beyond this much clearance a lower bound of it is good enough."""


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
            for c in range(n_cuboids):
                findings.add_series(
                    f"clearance_{part.kind}",
                    _or_nothing(required[:, c] - _gap(part, cuboids, c)),
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


def _gap(part: Part, cuboids: Cuboids, index: int) -> Array:
    """Clearance (T,) of a part to one cuboid: exact where it is small, a lower bound elsewhere."""
    half, rotation = 0.5 * cuboids.size_m[index], cuboids.rotation[index]
    start = (part.start - cuboids.centre_w_m[index]) @ rotation
    end = (part.end - cuboids.centre_w_m[index]) @ rotation
    if part.half_m is not None:
        reach: Array | float = float(np.linalg.norm(part.half_m))
    else:
        reach = 0.5 * np.linalg.norm(end - start, axis=1) + part.radius_m
    gap = np.asarray(signed_distance_to_box(0.5 * (start + end), half) - reach)
    near = np.flatnonzero(gap < NEAR_M)  # NaN (a pose out of reach) is not
    if len(near) == 0:
        return gap
    moved = part.moved[near]
    moved[0] = True
    rows = near[moved]
    if part.half_m is not None and part.rotation is not None:
        exact = box_to_box(start[rows], rotation.T @ part.rotation[rows], part.half_m, half)
    else:
        exact = segment_to_box(start[rows], end[rows], half) - part.radius_m
    gap[near] = exact[np.cumsum(moved) - 1]
    return gap


def _height(part: Part) -> Array:
    """Clearance (T,) above the wall plane z = 0."""
    if part.half_m is not None and part.rotation is not None:
        return part.start[:, 2] - np.abs(part.rotation[:, 2, :]) @ part.half_m
    return np.minimum(part.start[:, 2], part.end[:, 2]) - part.radius_m
