"""Footholds as contacts: a gripper stands on a surface with both pads and pushes, its z along the surface's normal.

To balance and to the exact program it is a grasp by faces that lean by a right angle: both normals are the surface's,
shear across the opening axis and the forces along it are what slides, and pads touch as if at the foot point. What is
different, its bounds, asks for `Contact.foot`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_contracts.scenario import Foothold, Scenario
from crux_msgs import limb_knot_t

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.contacts import BESIDE_M, Contact, GripperShape, outline
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.surfaces import Surfaces
from crux_planner.model.unusable import WALL_CLEARANCE_M

_OPENINGS = 9  # that are tried
_SQUARE_RAD = np.pi / 2


@dataclass(frozen=True)
class Stands:
    """What footholds offer grippers whose yaw, off the heading of the start, is in a range."""

    scenario: Scenario
    cuboids: Cuboids
    surfaces: Surfaces
    shape: GripperShape
    heading_rad: float
    yaw_range: tuple[float, float]
    final_yaw_rad: float
    finger_clearance_m: float

    def contacts(self) -> tuple[list[Contact], dict[tuple[int, int], str]]:
        """All of them, and why a foothold (its index as that of a hold, pair 0) offers none."""
        contacts: list[Contact] = []
        unusable: dict[tuple[int, int], str] = {}
        for number, foothold in enumerate(self.scenario.footholds):
            index = len(self.scenario.cuboids) + number
            found = self._on(index, foothold)
            if isinstance(found, str):
                unusable[index, 0] = found
            else:
                contacts += found
        return contacts, unusable

    def _on(self, index: int, foothold: Foothold) -> list[Contact] | str:
        """With the opening axis as the body heads, at the start and at the goal; where there is no space so, square to
        that.
        """
        if foothold.friction <= 0.0:
            return "its surface has no friction"
        to_h = rotation_z(-self.heading_rad)
        _, tilt_rad = yaw_and_tilt(to_h @ rotation_from_rpy(np.array(foothold.rpy_rad)))
        place = to_h @ np.array(foothold.position_m)
        found: list[Contact] = []
        for square in (0.0, _SQUARE_RAD):
            for yaw in sorted({square, square + self.final_yaw_rad}):
                turn = gripper_rotation(yaw, tilt_rad)
                opening = self._opening(place, turn, foothold.surface)
                if opening is not None and self.yaw_range[0] <= yaw <= self.yaw_range[1]:
                    found.append(self._contact(index, foothold, yaw, tilt_rad, place, opening))
            if found:
                return found
        return "fingers and palm have no space there, or pads reach beyond its surface"

    def _contact(
        self, index: int, foothold: Foothold, yaw: float, tilt_rad: Array, place: Array, opening: float
    ) -> Contact:
        up = gripper_rotation(yaw, tilt_rad)[:, 2]
        return Contact(
            hold=index,
            pair=0,
            finger1_face=limb_knot_t.FACE_WALL,
            yaw_rad=yaw,
            centre_h_m=place + self.shape.pad_radius * up,
            separation_m=2 * opening,
            friction=np.full(2, foothold.friction),
            spines=np.zeros((2, 3)),
            open_m=opening,
            lean_rad=np.full(2, np.pi / 2),
            pad_radius_m=self.shape.pad_radius,
            tilt_rad=tilt_rad if self.scenario.tilts else None,
            foot=True,
        )

    def _opening(self, place: Array, turn: Array, surface: str) -> float | None:
        """The nearest to the preferred one at which fingers and palm keep off all but the surface, on which both pads
        stand as a whole; None where there is none.
        """
        shape, centre = self.shape, place + self.shape.pad_radius * turn[:, 2]
        openings = np.linspace(shape.smallest_opening, shape.largest_opening, _OPENINGS)
        openings = openings[np.argsort(np.abs(openings - shape.open_opening), kind="stable")]
        own = np.array([name == surface for name in self.surfaces.names], dtype=bool)
        others = self.surfaces.slabs.some(~own) if len(own) else self.surfaces.slabs
        beyond_m = shape.pad_radius + WALL_CLEARANCE_M
        for opening in openings.tolist():
            ends = (opening + shape.pad_radius) * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
            hand, pads = centre + outline(opening, shape) @ turn.T, centre + ends @ turn.T
            if own.any() and self._beyond_m(pads, own) > -shape.pad_radius:
                continue
            if len(self.cuboids.yaw_rad) and (
                self.cuboids.distance(hand).min() < shape.pad_radius + BESIDE_M
                or self.cuboids.distance(pads).min() < self.finger_clearance_m
            ):
                continue
            if len(others.yaw_rad) and others.distance(hand).min() < beyond_m:
                continue
            if self.surfaces.endless and surface and hand[:, 2].min() < beyond_m:
                continue
            return float(opening)
        return None

    def _beyond_m(self, points: Array, own: Flags) -> float:
        """How far points (n, 3) are beyond the edges of their own surface at most; negative within."""
        return float(self.surfaces.slabs.some(own).excess(points)[:, 0, :2].max())
