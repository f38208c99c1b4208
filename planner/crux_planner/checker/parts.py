"""The solid parts of the robot along the way, in W: links as inverse kinematics has them, palm and fingers as planned.

Shapes are those of the URDF (cylinders as capsules, boxes as boxes), the pads spheres as in the robot description.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crux_planner.checker.geometry import Array, Flags, Indices, turned, turned_by
from crux_planner.checker.kinematics import LimbMotion
from crux_planner.checker.limb_model import Limb, Link
from crux_planner.checker.sampling import Samples

BLOCK = 32
"""Samples in a row that are looked at together, before each by itself."""


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
    on_body: bool = False  # it turns on the body by its first joint

    def at(self, some: Indices) -> Part:
        """The part at some of the samples."""
        if len(some) == len(self.start):
            return self
        start = self.start.T[:, some].T  # component by component, as it was
        end = start if self.end is self.start else self.end.T[:, some].T
        return replace(self, start=start, end=end, rotation=None if self.rotation is None else self.rotation[some])

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """Corners (3, T), (3, T) of the box around the part."""
        margin = self.radius_m if self.half_m is None else float(np.linalg.norm(self.half_m))
        start, end = self.start.T, self.end.T
        return np.minimum(start, end) - margin, np.maximum(start, end) + margin

    @cached_property
    def blocks(self) -> tuple[Array, Array]:
        """Corners (3, blocks), (3, blocks) of the box around the part over some samples in a row."""
        first = np.arange(0, len(self.start), BLOCK)
        low, high = self.corners
        return np.fmin.reduceat(low, first, axis=1), np.fmax.reduceat(high, first, axis=1)

    @cached_property
    def moved(self) -> Flags:
        """(T,) False where the part is exactly where it was one sample before: a gripper at rest."""
        moved = np.ones(len(self.start), dtype=bool)
        if self.kind not in ("finger", "palm"):
            return moved  # it hangs on the body
        moved[1:] = (np.diff(self.start, axis=0) != 0.0).any(axis=1) | (np.diff(self.end, axis=0) != 0.0).any(axis=1)
        if self.rotation is not None:
            moved[1:] |= (np.diff(self.rotation, axis=0) != 0.0).any(axis=(1, 2))
        return moved


def limb_parts(samples: Samples, limb: Limb, index: int, motion: LimbMotion, pad_radius_m: float) -> list[Part]:
    """Links, palm and fingers of limb number `index`; a link is nowhere (NaN) where its limb does not reach."""
    hand = samples.gripper_rotation[:, index]
    gripper = samples.gripper_position[:, index]
    slides = {joint.child: joint for joint in limb.fingers}
    parts = []
    for link in limb.links:
        if link.name not in slides and link.name != limb.gripper:
            parts += _link_parts(samples, link, motion, on_body=link.name in limb.on_body)
            continue
        position, rotation, finger = gripper, hand, None
        if link.name in slides:
            slide, finger = slides[link.name], list(slides).index(link.name) + 1
            offset = slide.origin_m + samples.opening[:, index, None] * (slide.rotation @ slide.axis)
            position, rotation = gripper + turned(hand, offset), turned_by(hand, slide.rotation)
        kind = "finger" if finger else "palm"
        parts += shapes(kind, link, position, rotation, finger)
        if finger:
            pad = position + turned(rotation, pad_radius_m * slide.axis)
            following = np.concatenate([pad[1:], pad[-1:]])
            parts.append(Part(kind, finger, pad, following, pad_radius_m))
    return parts


def _link_parts(samples: Samples, link: Link, motion: LimbMotion, *, on_body: bool) -> list[Part]:
    """A link's shapes as inverse kinematics has them."""
    if not (link.capsules or link.boxes):
        return []
    position = samples.body_position + turned(samples.rotation, motion.state.link_position_m[link.name])
    position[~motion.reached] = np.nan  # nowhere: reported as out of reach already
    rotation = np.einsum("nij,njk->ikn", samples.rotation, motion.state.link_rotation[link.name]).transpose(2, 0, 1)
    return shapes("link", link, position, rotation, on_body=on_body)


def shapes(
    kind: str, link: Link, position: Array, rotation: Array, finger: int | None = None, *, on_body: bool = False
) -> list[Part]:
    """A link's capsules and boxes where the link is."""
    parts = []
    for capsule in link.capsules:
        start, end = (position + turned(rotation, point) for point in (capsule.start_m, capsule.end_m))
        parts.append(Part(kind, finger, start, end, capsule.radius_m, on_body=on_body))
    for box in link.boxes:
        centre = position + turned(rotation, box.centre_m)
        parts.append(Part(kind, finger, centre, centre, 0.0, box.half_m, turned_by(rotation, box.rotation), on_body))
    return parts
