"""The solid parts of the robot along the way, in W: links as inverse kinematics has them, palm and fingers as planned.

Shapes are those of the URDF (cylinders as capsules, boxes as boxes), the pads spheres as in the robot description.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from crux_planner.checker.geometry import Array, rotation_about_z
from crux_planner.checker.kinematics import LimbMotion
from crux_planner.checker.limb_model import Limb, Link
from crux_planner.checker.sampling import Samples


@dataclass(frozen=True)
class Part:
    """One shape of the robot over the samples, in W: a capsule from start to end, or a box where `half_m` is given."""

    kind: str  # finger, palm, link or body
    finger: int | None
    start: Array  # (T, 3); a box's centre
    end: Array
    radius_m: float
    half_m: Array | None = None
    rotation: Array | None = None

    @cached_property
    def moved(self) -> NDArray[np.bool_]:
        """(T,) False where the part is exactly where it was one sample before: a gripper at rest."""
        moved = np.ones(len(self.start), dtype=bool)
        moved[1:] = (np.diff(self.start, axis=0) != 0.0).any(axis=1) | (np.diff(self.end, axis=0) != 0.0).any(axis=1)
        if self.rotation is not None:
            moved[1:] |= (np.diff(self.rotation, axis=0) != 0.0).any(axis=(1, 2))
        return moved


def limb_parts(samples: Samples, limb: Limb, index: int, motion: LimbMotion, pad_radius_m: float) -> list[Part]:
    """Links, palm and fingers of limb number `index`; a link is nowhere (NaN) where its limb does not reach."""
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
            parts.append(Part(kind, finger, start, end, capsule.radius_m))
        for box in link.boxes:
            centre = position + rotation @ box.centre_m
            parts.append(Part(kind, finger, centre, centre, 0.0, box.half_m, rotation @ box.rotation))
        if finger:
            pad = position + rotation @ (pad_radius_m * slides[link.name].axis)
            following = np.concatenate([pad[1:], pad[-1:]])
            parts.append(Part(kind, finger, pad, following, pad_radius_m))
    return parts


def _turn(rotation: Array, vector: Array) -> Array:
    return np.asarray((rotation @ vector[..., None])[..., 0])


def body_parts(samples: Samples, body: Link) -> list[Part]:
    """The body's boxes and capsules."""
    position, rotation = samples.body_position, samples.rotation
    parts = []
    for box in body.boxes:
        centre = position + rotation @ box.centre_m
        parts.append(Part("body", None, centre, centre, 0.0, box.half_m, rotation @ box.rotation))
    for capsule in body.capsules:
        start, end = position + rotation @ capsule.start_m, position + rotation @ capsule.end_m
        parts.append(Part("body", None, start, end, capsule.radius_m))
    return parts
