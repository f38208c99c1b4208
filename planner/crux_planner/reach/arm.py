"""The reach of a limb that yaws, pitches and pitches, with a spherical wrist, in closed form: the inner map and angles.

The wrist is straight above an upright gripper, at place + d z. Its radius rho and height h from the shoulder's axis
give joints 2 and 3 as a triangle does, its azimuth joint 1. What the body's tilt makes of the direction "up" gives
joints 4 and 5, and joint 6 is the gripper's yaw less the heading of the forearm's side. Limits are compared as
directions (`Sector`), so the map takes three square roots a pose and no trigonometry, whatever the tilt.

Angles of joint 6 are not wrapped: a gripper that swings from one grasp to another follows its yaw, and a map modulo a
whole turn would have grasps in reach between which the joint flips.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.robot import Limb, Robot

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import wrap_near
from crux_planner.reach import native, outer, solids
from crux_planner.reach.chain_reach import ChainReach
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach
from crux_planner.reach.sector import Sector
from crux_planner.reach.solids import NOTHING, Links, Solids

MARGIN_RAD = 0.05  # to joint limits: covers poses between those looked at, tracking, and encoder offsets
CLEAR_M = 0.006  # of links and trunk: twice the check's
STRAIGHT_ELBOW_COS = 0.9995  # beyond it the limb is stretched or folded, as in inverse kinematics
LEAST_RADIUS_M = 0.02  # of the wrist: nearer to the shoulder's axis, joint 1 turns fast
MOST_TURN_RAD = 2.6  # of joint 1 to either side: joint 6 is unwrapped from there


@dataclass(frozen=True)
class Posture:
    """A limb as directions: cosines and sines that broadcast to the poses' shape. Where the pose is out of the links'
    reach, they are of no limb.
    """

    up: tuple[Array, Array, Array]  # W's z in the body frame
    wrist: tuple[Array, Array, Array]  # off the shoulder, body frame [m]
    radius_m: Array
    azimuth: tuple[Array, Array]  # of the wrist; cosine, sine
    cos_elbow: Array
    upper: tuple[Array, Array]  # joint 2 [cosine, sine]
    forearm: tuple[Array, Array]  # its elevation, joint 2 less joint 3
    pitch: tuple[Array, Array]  # joint 4, times `pitch_length`
    pitch_length: Array
    sin_roll: Array  # joint 5
    side: tuple[Array, Array]  # azimuth of the limb seen along W's z, times `side_length`: what joint 6 turns against
    side_length: Array


def wrist_m(limb: Limb, cos_elbow: float) -> float:
    """Of a wrist from the shoulder, where the elbow has this cosine."""
    l1, l2 = limb.upper_link_m, limb.lower_link_m
    return float(np.sqrt(l1**2 + l2**2 + 2 * l1 * l2 * cos_elbow))


def cos_elbow_at(limb: Limb, wrist_m: float) -> float:
    """The cosine of the elbow, where the wrist is so far from the shoulder."""
    l1, l2 = limb.upper_link_m, limb.lower_link_m
    return float((wrist_m**2 - l1**2 - l2**2) / (2 * l1 * l2))


@dataclass(frozen=True)
class ArmReach:
    """One limb. Raises ValueError for a limb whose joints turn so far that angles are not one of a kind.

    `keep_off` are the shapes of the inner map, `certain` those of the outer one.
    """

    limb: Limb
    margin_rad: float = MARGIN_RAD
    clear_m: float = CLEAR_M
    keep_off: Solids = NOTHING
    certain: Solids = NOTHING

    def __post_init__(self) -> None:
        low, high = self.limb.lower_rad, self.limb.upper_rad
        if low[2] < 0.0 or high[2] > np.pi:
            raise ValueError(f"{self.limb.name}: joint 3 turns {low[2]:g}..{high[2]:g} rad, expected within 0..pi")
        if max(-low[4], high[4]) >= np.pi / 2:
            raise ValueError(f"{self.limb.name}: joint 5 turns {low[4]:g}..{high[4]:g} rad, expected within +-pi/2")
        if high[0] - low[0] > 2 * MOST_TURN_RAD:
            most = f"expected at most {2 * MOST_TURN_RAD:g} rad"
            raise ValueError(f"{self.limb.name}: joint 1 turns {low[0]:g}..{high[0]:g} rad, {most}")

    @cached_property
    def low_rad(self) -> Array:
        """(6,) that joints keep to."""
        return self.limb.lower_rad + self.margin_rad

    @cached_property
    def high_rad(self) -> Array:
        """(6,)"""
        return self.limb.upper_rad - self.margin_rad

    @cached_property
    def sectors(self) -> tuple[Sector, Sector, Sector]:
        """Of the wrist's azimuth, of joint 2, and of joint 4."""
        low, high, first = self.low_rad, self.high_rad, self.limb.mount_rad
        azimuth = Sector.between(first + low[0], first + high[0])
        return azimuth, Sector.between(low[1], high[1]), Sector.between(low[3], high[3])

    @cached_property
    def cos_elbow(self) -> tuple[float, float]:
        """Least and most."""
        least, most = np.cos(self.high_rad[2]), np.cos(self.low_rad[2])
        return max(float(least), -STRAIGHT_ELBOW_COS), min(float(most), STRAIGHT_ELBOW_COS)

    @cached_property
    def sin_roll(self) -> tuple[float, float]:
        """Of joint 5, least and most."""
        return float(np.sin(self.low_rad[4])), float(np.sin(self.high_rad[4]))

    @cached_property
    def _native(self) -> native.Arm:
        shapes = self.keep_off, self.clear_m
        return native.arm(self.limb, LEAST_RADIUS_M, self.cos_elbow, self.sin_roll, self.sectors, *shapes)

    @cached_property
    def outer(self) -> native.Arm:
        """With joint limits as they are and the shapes that are certain, for proofs."""
        (low, high), limb = (self.limb.lower_rad, self.limb.upper_rad), self.limb
        first = limb.mount_rad
        ranges = ((first + low[0], first + high[0]), (low[1], high[1]), (low[3], high[3]))
        elbow = float(np.cos(high[2])), float(np.cos(low[2]))
        roll = float(np.sin(low[4])), float(np.sin(high[4]))
        azimuth, upper, pitch = (Sector.between(*each) for each in ranges)
        return native.arm(limb, 0.0, elbow, roll, (azimuth, upper, pitch), self.certain, 0.0)

    @property
    def last_rad(self) -> tuple[float, float]:
        """What a gripper's yaw is less that of the limb's side, least and most."""
        mount = self.limb.gripper_mount_rad
        return float(self.limb.lower_rad[5] + mount), float(self.limb.upper_rad[5] + mount)

    @cached_property
    def forward_rad(self) -> float:
        """The azimuth in the middle of joint 1."""
        return float(self.limb.mount_rad + (self.limb.lower_rad[0] + self.limb.upper_rad[0]) / 2)

    def sides(self, yaw_rad: Array) -> Sector:
        """The azimuths, as `Posture.side` has them, at which joint 6 is in range for grippers of these yaws."""
        ahead = yaw_rad - self.limb.gripper_mount_rad - self.forward_rad
        low, high = np.maximum(ahead - self.high_rad[5], -np.pi), np.minimum(ahead - self.low_rad[5], np.pi)
        return Sector.between(low + self.forward_rad, np.where(high < low, low - 1.0, high) + self.forward_rad)

    def posture(self, poses: GripperPoses) -> Posture:
        """Of the limb with its gripper at these poses."""
        cr, sr = np.cos(poses.roll_rad), np.sin(poses.roll_rad)
        cp, sp = np.cos(poses.pitch_rad), np.sin(poses.pitch_rad)
        limb, high = self.limb, poses.z_m + self.limb.wrist_to_gripper_m
        l1, l2 = limb.upper_link_m, limb.lower_link_m
        ahead, above = cp * poses.x_m - sp * high, sp * poses.x_m + cp * high
        x = ahead - limb.shoulder_b_m[0]
        y = cr * poses.y_m + sr * above - limb.shoulder_b_m[1]
        h = cr * above - sr * poses.y_m - limb.shoulder_b_m[2]
        squared = x * x + y * y
        radius = np.sqrt(squared)
        ca, sa = x / np.maximum(radius, 1e-9), y / np.maximum(radius, 1e-9)
        far = squared + h * h
        c3 = (far - (l1 * l1 + l2 * l2)) / (2 * l1 * l2)
        s3 = np.sqrt(np.maximum(1.0 - c3 * c3, 0.0))
        far = np.maximum(far, 1e-12)
        near, aside = l1 + l2 * c3, l2 * s3
        c2, s2 = (radius * near - h * aside) / far, (h * near + radius * aside) / far
        near, aside = l2 + l1 * c3, l1 * s3
        ce, se = (radius * near + h * aside) / far, (h * near - radius * aside) / far
        ux, uy, uz = -sp, sr * cp, cr * cp
        outward, sideward = ux * ca + uy * sa, uy * ca - ux * sa
        c4, s4 = uz * ce - outward * se, outward * ce + uz * se
        east, north = cr * ca, cp * sa - sp * sr * ca
        return Posture(
            up=(ux, uy, uz),
            wrist=(x, y, h),
            radius_m=radius,
            azimuth=(ca, sa),
            cos_elbow=c3,
            upper=(c2, s2),
            forearm=(ce, se),
            pitch=(c4, s4),
            pitch_length=np.sqrt(outward * outward + uz * uz),
            sin_roll=-sideward,
            side=(east, north),
            side_length=np.sqrt(east * east + north * north),
        )

    def reaches(self, poses: GripperPoses) -> Flags:
        """Inner map: see `Reach`. By numpy where the compiled one is missing."""
        compiled = native.library()
        if compiled is None:
            return self.reaches_by_numpy(poses)
        return native.reaches(compiled, self._native, poses, self.sides(np.asarray(poses.yaw_rad)))

    def reaches_by_numpy(self, poses: GripperPoses) -> Flags:
        """The same."""
        found = self.posture(poses)
        ok = np.array(self._within_limits(found, poses.yaw_rad), order="C")
        if not self.keep_off.trunk:
            return ok
        near = np.flatnonzero(ok)
        clear = self.off_trunk(poses.where(near))
        ok.reshape(-1)[near[~clear]] = False
        return ok

    def angles(self, poses: GripperPoses) -> Array:
        """(..., 6): see `Reach`. Joint 1 is the angle nearest to the middle of its range."""
        found, limb = self.posture(poses), self.limb
        q1 = wrap_near(np.arctan2(found.azimuth[1], found.azimuth[0]), self.forward_rad) - limb.mount_rad
        side = wrap_near(np.arctan2(found.side[1], found.side[0]), self.forward_rad)
        q = (
            q1,
            np.arctan2(found.upper[1], found.upper[0]),
            np.arccos(np.clip(found.cos_elbow, -1.0, 1.0)),
            np.arctan2(found.pitch[1], found.pitch[0]),
            np.arcsin(np.clip(found.sin_roll, -1.0, 1.0)),
            poses.yaw_rad - side - limb.gripper_mount_rad,
        )
        return np.stack(np.broadcast_arrays(*q), axis=-1)

    def cannot(self, low: GripperPoses, high: GripperPoses) -> Flags:
        """Outer map: see `Reach`."""
        return outer.cannot(self.limb, self.certain, low, high)

    def links(self, poses: GripperPoses) -> Links:
        """See `Reach`; the first link comes last. By numpy where the compiled ones are missing."""
        compiled = native.library()
        if compiled is None:
            return self.links_by_numpy(poses)
        capsules = (*self.keep_off.links, *self.keep_off.first)
        return Links(*native.links(compiled, self._native, poses), *solids.radii_and_hands(capsules))

    def links_by_numpy(self, poses: GripperPoses) -> Links:
        """The same."""
        frames = self._frames(poses, self.posture(poses))
        capsules = (*self.keep_off.links, *self.keep_off.first)
        placed = [(*frames[each.frame], each) for each in capsules]
        ends = [[origin + turn @ each.start_m, origin + turn @ each.end_m] for origin, turn, each in placed]
        start, end = np.moveaxis(np.array(ends).reshape(len(placed), 2, *poses.shape, 3), 0, -2)
        return Links(start, end, *solids.radii_and_hands(capsules))

    def off_trunk(self, poses: GripperPoses) -> Flags:
        """(n,) whether all links keep off the trunk, for poses (n,) within the links' reach."""
        return solids.off_trunk(self.keep_off, self.links(poses), self.clear_m)

    def _within_limits(self, found: Posture, yaw_rad: Array) -> Flags:
        azimuth, upper, pitch = self.sectors
        least, most = self.cos_elbow
        ok = (found.radius_m >= LEAST_RADIUS_M) & (found.cos_elbow >= least) & (found.cos_elbow <= most)
        ok = ok & azimuth.has(*found.azimuth, 1.0) & upper.has(*found.upper, 1.0)
        ok = ok & pitch.has(*found.pitch, found.pitch_length)
        ok = ok & (found.sin_roll >= self.sin_roll[0]) & (found.sin_roll <= self.sin_roll[1])
        return ok & self.sides(yaw_rad).has(*found.side, found.side_length)

    def _frames(self, poses: GripperPoses, found: Posture) -> list[tuple[Array, Array]]:
        """Origins (n, 3) and rotations (n, 3, 3) of the capsules' frames, by number, in the body frame."""
        place, hand = poses.in_body()
        (ca, sa), (c2, s2), (ce, se) = found.azimuth, found.upper, found.forearm
        zero, up = np.zeros(poses.shape), hand[..., :, 2]
        outward = np.stack(np.broadcast_arrays(ca, sa, zero), axis=-1)
        side = np.stack(np.broadcast_arrays(-sa, ca, zero), axis=-1)
        upper = np.stack(np.broadcast_arrays(ca * c2, sa * c2, s2), axis=-1)
        forearm = np.stack(np.broadcast_arrays(ca * ce, sa * ce, se), axis=-1)
        across = np.cross(side, up)
        rolled = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
        elbow = self.limb.shoulder_b_m + self.limb.upper_link_m * upper
        wrist = place + self.limb.wrist_to_gripper_m * up
        shoulder = np.broadcast_to(self.limb.shoulder_b_m, elbow.shape)
        axes = ((upper, side), (forearm, side), (rolled, side), (rolled, np.cross(up, rolled)))
        turns = [np.stack([x, y, np.cross(x, y)], axis=-1) for x, y in axes]
        yawed = shoulder, np.stack([outward, side, np.cross(outward, side)], axis=-1)
        return [*zip((shoulder, elbow, wrist, wrist), turns, strict=True), (place, hand), yawed]


_KNOWN: dict[tuple[str, float, float], tuple[Reach, ...]] = {}


def reaches_of(robot: Robot, margin_rad: float = MARGIN_RAD, clear_m: float = CLEAR_M) -> tuple[Reach, ...]:
    """Of all limbs of a robot, in limb order; once a process for robots of one hash. By ArmReach where limbs have a
    closed form, else by ChainReach.
    """
    key = robot.hash, margin_rad, clear_m
    if key not in _KNOWN:
        made: list[Reach] = []
        for limb in robot.limbs:
            outside, inside = (solids.solids(robot, limb, around=around) for around in (True, False))
            if limb.closed_form:
                made.append(ArmReach(limb, margin_rad, clear_m, outside, inside))
            else:
                made.append(ChainReach(limb, margin_rad, clear_m, outside))
        _KNOWN[key] = tuple(made)
    return _KNOWN[key]
