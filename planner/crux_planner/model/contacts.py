"""Grasps a gripper can take: hold, face pair and gripper yaw, with what equation (10) fixes while it holds on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation

from crux_planner.model.arrays import Array
from crux_planner.model.cuboids import NO_CUBOIDS, Cuboids

PAIR_NAMES = ("x", "y")
FACE_NAMES = ("+x", "-x", "+y", "-y")  # by number, as limb_knot_t has them
_NO_TILT = np.zeros(2)
_ALONG = np.linspace(0.0, 1.0, 5)
BESIDE_M = 0.004  # of fingers and palms to turned cuboids beside them


@dataclass(frozen=True)
class GripperShape:
    """What of a gripper can touch the wall's cuboids; lengths in m."""

    smallest_opening: float  # pad face to gripper centre
    largest_opening: float
    open_opening: float  # preferred for swings
    pad_radius: float  # a finger reaches from its pad face one pad diameter outwards; half the width of the palm
    finger_height: float  # above the pad centre, up to the palm

    def half_length(self, opening_m: Array | float) -> Array:
        """Half the length of its footprint: the palm carries the whole travel of the fingers."""
        return np.maximum(self.largest_opening, np.asarray(opening_m) + 2 * self.pad_radius)


@dataclass(frozen=True)
class SwingLimits:
    """What bounds a swing."""

    dt_s: float
    speed_m_s: float
    yaw_rate_rad_s: float
    clearance_m: float  # of the middle of a finger to cuboids
    body_clearance_m: float  # of palms and fingers among grippers and beside tall cuboids
    max_height_m: float  # of a pad above W's z = 0, where this is a surface; else above the upper hold's foot
    endless: bool = True  # whether z = 0 is a surface
    floor_m: float = 0.0  # of the plane z = 0
    slabs: Cuboids = NO_CUBOIDS  # behind bounded surfaces: the way is over these, too

    def overhead_m(self, shape: GripperShape) -> float:
        """Above it nothing is in the way of a gripper on a swing: no palm gets so near to it."""
        highest_m = self.max_height_m + shape.finger_height + shape.pad_radius
        return float(highest_m + shape.half_length(shape.largest_opening) + self.clearance_m)

    def over(self, feet_m: Array) -> SwingLimits:
        """Those of a swing between holds whose feet are at heights (n,)."""
        highest_m = float(feet_m.max()) if len(feet_m) else 0.0
        return replace(self, max_height_m=self.max_height_m + highest_m, floor_m=-np.inf)


@dataclass(frozen=True)
class Contact:
    """One way to grip one hold. Finger 1 sits at +e of the opening axis e."""

    hold: int
    pair: int  # 0: faces +x and -x, 1: +y and -y
    finger1_face: int  # as limb_knot_t: 0 +x, 1 -x, 2 +y, 3 -y
    yaw_rad: float  # of the gripper in H, before it is tilted
    centre_h_m: Array  # (3,)
    separation_m: float
    friction: Array  # (2,) of the faces of fingers 1 and 2
    spines: Array  # (2, 3) most that the spines of each finger hold of (s1, s2, m) by (3); 0 where its face has none
    open_m: float  # opening with which the gripper leaves and comes
    spines_only: int = 0  # the finger (1 or 2) whose normal force is 0, 0 for none
    bears: bool = True  # False: a gripper in the air at the start; `hold` is what it surrounds, < 0 for nothing
    lean_rad: Array = field(default_factory=lambda: np.zeros(2))  # of the faces of fingers 1 and 2, see `normals`
    pad_radius_m: float = 0.0  # pads are balls that touch a leaning face beside the opening axis
    tilt_rad: Array | None = None  # (2,) of the gripper, see model.hands; None where all of a problem are upright
    grip: int = 0  # number of the hold's grips on these faces
    foot: bool = False  # it stands on a foothold, number `hold` after the cuboids, see model.footholds

    @property
    def grip_friction(self) -> Array:
        """Friction (2,) that the fingers can use: a finger that does not press, none.

        Nor has the other a use for any where its spines hold as much: both bear the same shear and twist (4).
        """
        usable = self.friction * self.may_press
        weak = int(np.argmin(usable))
        enough = usable[weak] <= 0.0 and (self.spines[weak] <= self.spines[1 - weak]).all()
        return np.zeros(2) if enough else usable

    @property
    def slippery(self) -> bool:
        """Whether one of its fingers, and so neither, carries any shear."""
        return bool(((self.grip_friction <= 0.0) & (self.spines[:, 0] <= 0.0)).any())

    @property
    def may_press(self) -> Array:
        """1 for a finger that may press, 0 for one that may not, (2,)."""
        return np.array([float(self.bears and self.spines_only != finger) for finger in (1, 2)])

    @property
    def axis(self) -> Array:
        """Opening axis e, the outward normal of finger 1's face."""
        return self._rotation[:, 0]

    @property
    def up(self) -> Array:
        """The way off the hold, across the opening axis: H's z where the gripper is upright."""
        return self._rotation[:, 2]

    @cached_property
    def _rotation(self) -> Array:
        rotation = gripper_rotation(self.yaw_rad, _NO_TILT if self.tilt_rad is None else self.tilt_rad)
        rotation.setflags(write=False)
        return rotation

    @property
    def tilted(self) -> bool:
        """Whether its gripper is not upright."""
        return self.tilt_rad is not None and bool(self.tilt_rad.any())

    @property
    def leans(self) -> bool:
        """Whether a face is not across the opening axis."""
        return bool(self.lean_rad.any())

    @property
    def place_h_m(self) -> Array:
        """(3,) of a foothold, below its gripper's centre."""
        return np.asarray(self.centre_h_m - self.pad_radius_m * self.up)

    @property
    def normals(self) -> Array:
        """(2, 3) outward normals of the faces of fingers 1 and 2, which lean off the wall."""
        return face_normals(self.axis, self.up, self.lean_rad)

    @property
    def touch_m(self) -> Array:
        """(2, 3) where the pads of fingers 1 and 2 touch, off their faces on the opening axis."""
        return touch_off_axis_m(self.axis, self.normals, self.pad_radius_m)

    @property
    def leaning_moments(self) -> Array:
        """(3, 5) moments about the gripper's centre of q = (s1, s2, m, n1, n2), less those on upright faces: pads touch
        beside the axis, and twist about the faces' normals.
        """
        normals, axis, up, off = self.normals, self.axis, self.up, self.touch_m
        columns = [np.cross(off.sum(axis=0), self.tangent), np.cross(off.sum(axis=0), up)]
        columns += [normals[0] - normals[1] - 2 * axis, np.cross(off[0], axis), -np.cross(off[1], axis)]
        return np.stack(columns, axis=1)

    @property
    def pose(self) -> Array:
        """(5,) x, y, z, yaw and opening of a gripper that holds on, (7,) where it has a tilt."""
        tilt = () if self.tilt_rad is None else self.tilt_rad
        return np.array([*self.centre_h_m, self.yaw_rad, self.separation_m / 2, *tilt])

    @property
    def tangent(self) -> Array:
        """Across the opening axis, in the wall's plane where the gripper is upright."""
        return self._rotation[:, 1]


def face_normals(axis: Array, up: Array, lean_rad: Array) -> Array:
    """(2, 3) outward normals of the faces of fingers 1 and 2, across an opening axis (3,), leaning by (2,) to `up`."""
    return np.asarray(np.outer(np.cos(lean_rad) * [1.0, -1.0], axis) + np.outer(np.sin(lean_rad), up))


def touch_off_axis_m(axis: Array, normals: Array, pad_radius_m: float) -> Array:
    """(2, 3) where pads, which are balls, touch such faces, off their own faces on the axis."""
    return np.asarray(pad_radius_m * (np.outer([1.0, -1.0], axis) - normals))


@dataclass(frozen=True)
class Grip:
    """A hold and a face pair as proofs know them: a grasp up to `aside_m` off the middle, anywhere in `height_m`."""

    contact: Contact
    aside_m: float
    height_m: tuple[float, float]

    def raised(self, by_m: float) -> Grip:
        """The same place so much further off the wall."""
        contact = replace(self.contact, centre_h_m=self.contact.centre_h_m + np.array([0.0, 0.0, by_m]))
        return replace(self, contact=contact, height_m=(self.height_m[0] + by_m, self.height_m[1] + by_m))


def yaws_in_range(axis_rad: float, allowed_rad: tuple[float, float]) -> list[tuple[float, bool]]:
    """Gripper yaws that put the fingers on a face pair, and whether finger 1 is then on the minus face.

    `axis_rad` is the direction of the plus face's normal; half turns swap the fingers.
    """
    first = int(np.ceil((allowed_rad[0] - axis_rad) / np.pi))
    last = int(np.floor((allowed_rad[1] - axis_rad) / np.pi))
    return [(axis_rad + n * np.pi, n % 2 != 0) for n in range(first, last + 1)]


def outline(opening_m: float, shape: GripperShape) -> Array:
    """Points (n, 3) along the middles of fingers and palm, in the gripper's axes; they are as thick as a pad."""
    finger, palm = opening_m + shape.pad_radius, float(shape.half_length(opening_m)) - shape.pad_radius
    fingers = [[side * finger, 0.0, share * shape.finger_height] for side in (-1, 1) for share in _ALONG]
    return np.array([*fingers, *([(2 * share - 1) * palm, 0.0, shape.finger_height] for share in _ALONG)])


def opening_for(
    contact_centre: Array,
    turn: Array,
    hold: int,
    half_m: float,
    cuboids: Cuboids,
    shape: GripperShape,
    clearance_m: float,
    lean_rad: float = 0.0,
) -> float | None:
    """Opening with which a gripper may leave this grasp: as near to the preferred one as its neighbours allow.

    The middle of each finger keeps `clearance_m` to every other cuboid on its whole way from closed to open; to the
    hold itself, the steeper face of which may lean, it keeps as much once open. Where cuboids or the gripper are
    turned, whole fingers and the palm keep off all others, too. None where the neighbours leave no such opening. `turn`
    (3, 3) is the gripper's, with the opening axis first.
    """
    axis = turn[:, 0]
    beyond = clearance_m - shape.pad_radius
    leaning = half_m + beyond / np.cos(lean_rad) if lean_rad else 0.0
    smallest = max(half_m + clearance_m - shape.pad_radius, leaning, shape.smallest_opening)
    others = np.arange(len(cuboids.yaw_rad)) != hold
    openings = np.linspace(smallest, shape.largest_opening, 9)
    if others.any():
        swings = np.linspace(half_m, openings, 9, axis=-1) + shape.pad_radius  # (openings, ways there)
        points = contact_centre + np.concatenate([swings, -swings], axis=1)[..., None] * axis
        met = cuboids.distance(points)[..., others].min(axis=(1, 2)) < clearance_m
        if not cuboids.upright or turn[2, 2] < 1.0:
            hands = contact_centre + np.array([outline(opening, shape) for opening in openings]) @ turn.T
            met |= cuboids.distance(hands)[..., others].min(axis=(1, 2)) < shape.pad_radius + BESIDE_M
        openings = openings[: int(np.argmax(met))] if met.any() else openings
    return float(openings[np.argmin(np.abs(openings - shape.open_opening))]) if len(openings) else None
