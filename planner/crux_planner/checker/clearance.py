"""(14), for the robot's real shapes and along the whole way: fingers, palms, links and body keep off holds, obstacles
and the wall.

Shapes are those of the URDF (cylinders as capsules, boxes as boxes), the pads spheres as in the robot description.
Clearance is measured exactly for capsules against cuboids (the distance to a convex set is convex along a segment) and
by the separating axis theorem for boxes. Pads, which pass closest, are followed along the chords between samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, box_to_box, rotation_about_z, segment_to_box, signed_distance_to_box
from crux_planner.checker.kinematics import LimbMotion
from crux_planner.checker.limb_model import Limb, WholeRobot
from crux_planner.checker.plan_arrays import Cuboids
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples
from numpy.typing import NDArray

NEAR_M = 0.03
"""Beyond this much clearance a lower bound of it is good enough."""


@dataclass(frozen=True)
class _Part:
    """One shape of a limb over the samples, in W: a capsule from start to end, or a box where `half_m` is given."""

    kind: str  # finger, palm or link
    finger: int | None
    start: Array  # (T, 3); a box's centre
    end: Array
    radius_m: float
    half_m: Array | None = None
    rotation: Array | None = None


def check_clearance(
    samples: Samples,
    cuboids: Cuboids,
    robot: WholeRobot,
    motions: list[LimbMotion],
    *,
    pad_radius_m: float,
    point_model: bool,
    findings: Findings,
) -> None:
    """Clearance of every part to every cuboid and to the wall, against what the moment asks for."""
    for index, limb in enumerate(robot.limbs):
        required = _required(samples, index, len(cuboids.names))
        for part in _parts(samples, limb, index, motions[index], pad_radius_m):
            name = f"clearance_{part.kind}"
            grips = part.kind == "finger"
            for c in range(len(cuboids.names)):
                gap = _gap(part, cuboids, c)
                need = required[:, c] if grips else np.full(len(gap), tolerances.MOVING_CLEARANCE_M)
                findings.add_series(
                    name,
                    _or_nothing(need - gap),
                    samples.time_s,
                    "m",
                    tolerance=tolerances.LENGTH_M,
                    limb=index,
                    finger=part.finger,
                    detail=f"to {cuboids.names[c]!r}",
                )
            if point_model and part.kind != "link":
                continue
            findings.add_series(
                "clearance_wall",
                _or_nothing(tolerances.MOVING_CLEARANCE_M - _height(part)),
                samples.time_s,
                "m",
                tolerance=tolerances.LENGTH_M,
                limb=index,
                finger=part.finger,
                detail=f"of the {part.kind}",
            )
    for box in robot.body.boxes:
        rotation = samples.rotation @ box.rotation
        centre = samples.body_position + samples.rotation @ box.centre_m
        part = _Part("body", None, centre, centre, 0.0, box.half_m, rotation)
        for c in range(len(cuboids.names)):
            findings.add_series(
                "clearance_body",
                tolerances.MOVING_CLEARANCE_M - _gap(part, cuboids, c),
                samples.time_s,
                "m",
                tolerance=tolerances.LENGTH_M,
                detail=f"to {cuboids.names[c]!r}",
            )
        findings.add_series(
            "clearance_wall",
            tolerances.MOVING_CLEARANCE_M - _height(part),
            samples.time_s,
            "m",
            tolerance=tolerances.LENGTH_M,
            detail="of the body",
        )


def _required(samples: Samples, limb: int, n_cuboids: int) -> Array:
    """Clearance (T, H) asked of a limb's fingers: none to the hold they grip, open on or close on."""
    required = np.full((len(samples.time_s), n_cuboids), tolerances.MOVING_CLEARANCE_M)
    own = samples.own_hold[:, limb]
    rows = np.flatnonzero(own >= 0)
    required[rows, own[rows]] = 0.0
    return required


def _parts(samples: Samples, limb: Limb, index: int, motion: LimbMotion, pad_radius_m: float) -> list[_Part]:
    """Links stand as inverse kinematics has them, palm and fingers as the plan wants them."""
    state = limb.forward(motion.q_rad)
    hand = rotation_about_z(samples.gripper_yaw[:, index])
    slides = {joint.child: joint for joint in limb.fingers}
    parts = []

    def pose(link: str) -> tuple[Array, Array]:
        if link in slides:
            slide = slides[link]
            offset = slide.origin_m + samples.opening[:, index, None] * (slide.rotation @ slide.axis)
            return samples.gripper_position[:, index] + _turn(hand, offset), hand @ slide.rotation
        if link == limb.gripper:
            return samples.gripper_position[:, index], hand
        position = samples.body_position + _turn(samples.rotation, state.link_position_m[link])
        position[~motion.reached] = np.nan  # nowhere: reported as out of reach already
        return position, samples.rotation @ state.link_rotation[link]

    for link in limb.links:
        position, rotation = pose(link.name)
        finger = list(slides).index(link.name) + 1 if link.name in slides else None
        kind = "finger" if finger else "palm" if link.name == limb.gripper else "link"
        for capsule in link.capsules:
            start, end = position + rotation @ capsule.start_m, position + rotation @ capsule.end_m
            parts.append(_Part(kind, finger, start, end, capsule.radius_m))
        for box in link.boxes:
            centre = position + rotation @ box.centre_m
            parts.append(_Part(kind, finger, centre, centre, 0.0, box.half_m, rotation @ box.rotation))
        if finger:
            pad = position + rotation @ (pad_radius_m * slides[link.name].axis)
            following = np.concatenate([pad[1:], pad[-1:]])
            parts.append(_Part(kind, finger, pad, following, pad_radius_m))
    return parts


def _or_nothing(amounts: Array) -> Array:
    """-inf, which is "does not apply", where a part is nowhere."""
    return np.where(np.isnan(amounts), -np.inf, amounts)


def _turn(rotation: Array, vector: Array) -> Array:
    return np.asarray((rotation @ vector[..., None])[..., 0])


def _gap(part: _Part, cuboids: Cuboids, index: int) -> Array:
    """Clearance (T,) of a part to one cuboid: exact where it is small, a lower bound elsewhere."""
    half, rotation = 0.5 * cuboids.size_m[index], cuboids.rotation[index]
    start = (part.start - cuboids.centre_w_m[index]) @ rotation
    if part.half_m is not None and part.rotation is not None:
        gap = signed_distance_to_box(start, half) - float(np.linalg.norm(part.half_m))
        near = _near(gap)
        gap[near] = box_to_box(start[near], rotation.T @ part.rotation[near], part.half_m, half)
        return gap
    end = (part.end - cuboids.centre_w_m[index]) @ rotation
    reach = 0.5 * np.linalg.norm(end - start, axis=1)
    gap = np.asarray(signed_distance_to_box(0.5 * (start + end), half) - reach - part.radius_m)
    near = _near(gap)
    gap[near] = segment_to_box(start[near], end[near], half) - part.radius_m
    return gap


def _near(gap: Array) -> NDArray[np.int_]:
    """Samples worth an exact distance; NaN (a pose out of reach) is not."""
    return np.flatnonzero(gap < NEAR_M)


def _height(part: _Part) -> Array:
    """Clearance (T,) above the wall plane z = 0."""
    if part.half_m is not None and part.rotation is not None:
        return part.start[:, 2] - np.abs(part.rotation[:, 2, :]) @ part.half_m
    return np.minimum(part.start[:, 2], part.end[:, 2]) - part.radius_m
