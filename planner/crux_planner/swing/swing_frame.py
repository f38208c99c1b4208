"""The axes in which a swing is planned: its z halves the angle between the ways off both holds, so that the way from
one hold to another is straight off these, and across at one height over what lies between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.cuboids import Cuboids

_LOCK = 1e-6  # sine of the angle between an axis and z
_LEAST_COS = -0.5  # of the angle between the ways off two holds


@dataclass(frozen=True)
class SwingFrame:
    """H turned about a point."""

    rotation: Array  # (3, 3) H <- these axes
    about_h_m: Array  # (3,)

    @classmethod
    def between(cls, start: Contact, end: Contact) -> SwingFrame | None:
        """About the middle of two contacts; None where they look so far away from each other that no way over all that
        is between leaves both.
        """
        if start.up @ end.up < _LEAST_COS:
            return None
        up = start.up + end.up
        sine = np.hypot(up[0], up[1])
        angle = np.arctan2(sine, up[2])
        tilt = np.array([-up[1], up[0]]) * (angle / sine if sine > 0.0 else 0.0)
        return cls(gripper_rotation(0.0, tilt), (start.centre_h_m + end.centre_h_m) / 2)

    def points(self, points_h_m: Array) -> Array:
        """Points (..., 3) as these axes have them."""
        return np.asarray((points_h_m - self.about_h_m) @ self.rotation + self.about_h_m)

    def contact(self, contact: Contact) -> Contact:
        """A contact as these axes have it."""
        assert contact.tilt_rad is not None
        yaw, tilt = yaw_and_tilt(self.rotation.T @ gripper_rotation(contact.yaw_rad, contact.tilt_rad))
        centre = self.points(contact.centre_h_m)
        return replace(contact, centre_h_m=centre, yaw_rad=_near(yaw, contact.yaw_rad), tilt_rad=tilt)

    def cuboids(self, cuboids: Cuboids) -> Cuboids:
        """Cuboids as these axes have them."""
        if not len(cuboids.yaw_rad):
            return cuboids
        turned, foot = self.rotation.T @ cuboids.rotation, self.points(cuboids.foot_m)
        level = np.hypot(turned[:, 0, 0], turned[:, 1, 0])  # 0 where x is along z: then the yaw counts as roll
        lock = level < _LOCK
        roll = np.where(
            lock, np.arctan2(-turned[:, 1, 2], turned[:, 1, 1]), np.arctan2(turned[:, 2, 1], turned[:, 2, 2])
        )
        pitch = np.arctan2(-turned[:, 2, 0], level)
        yaw = np.where(lock, 0.0, np.arctan2(turned[:, 1, 0], turned[:, 0, 0]))
        return Cuboids(foot[:, :2], cuboids.half_m, yaw, np.column_stack([roll, pitch]), foot[:, 2])

    def plan_line(self, line_h_m: Array | None) -> Array | None:
        """A line (2, 2) in plan view as these axes have it, at the height of the contacts."""
        if line_h_m is None:
            return None
        return self.points(np.column_stack([line_h_m, np.full(2, self.about_h_m[2])]))[:, :2]

    def back(self, stations: Array, start: Contact, end: Contact) -> Array:
        """Poses (k, 7) in H of stations in these axes, the first and last turned as the contacts in H are."""
        poses = stations.copy()
        poses[:, :3] = (stations[:, :3] - self.about_h_m) @ self.rotation.T + self.about_h_m
        for pose, station in zip(poses, stations, strict=True):
            yaw, tilt = yaw_and_tilt(self.rotation @ gripper_rotation(station[3], station[5:]))
            pose[3], pose[5:] = _near(yaw, station[3]), tilt
        for pose, contact in ((poses[0], start), (poses[-1], end)):
            pose[3], pose[5:] = contact.yaw_rad, contact.tilt_rad
        return poses


def _near(angle_rad: float, other_rad: float) -> float:
    """The same angle less whole turns, nearest to another."""
    return float(angle_rad + 2 * np.pi * np.round((other_rad - angle_rad) / (2 * np.pi)))
