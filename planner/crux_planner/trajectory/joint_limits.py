"""How far joints keep off their limits in the exact P1, and the moments between two knots at which they do as well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.trajectory.link_planes import OFF_M

_POSE = 6


@dataclass(frozen=True)
class Moment:
    """A share of an interval, where joints and links keep off their limits as at the knots."""

    interval: int
    share: float
    hands: Array  # (4, 4) x, y, z and yaw
    margin_rad: Array  # (4, S)
    apart_m: float = OFF_M  # that links keep off the trunk and off those of other limbs
    off: Array | None = None  # (6,) the body there, off the straight way from knot to knot; None until a plan was there
    clear: Array | None = None  # (6,) a pose nearby at which links keep off each other, where the path's is none

    def near(self, other: Moment, share: float) -> bool:
        """Whether they are in the same interval, and no more than a share of it apart."""
        return self.interval == other.interval and abs(self.share - other.share) <= share


@dataclass(frozen=True)
class JointLimits:
    """What joints keep to at the knots and between them, and the body so that links keep off each other."""

    path: Array  # (N + 1, 12) body states on whose side of the trunk links stay
    margin_rad: float
    moments: tuple[Moment, ...]
    near_m: Array  # (N + 1,) how far the body may be from the path; infinite where it need not be near

    @classmethod
    def about(cls, path: Array, margin_rad: float) -> JointLimits:
        """One margin for all joints at the knots alone, the body nowhere bound to the path."""
        return cls(path, margin_rad, (), np.full(len(path), np.inf))

    def at_moments(self) -> tuple[Array, Array, Array]:
        """Poses (B, 6) at the moments that planes are about, their shares (B,), and what the body is off (B, 6)."""
        at, share = np.array([m.interval for m in self.moments]), np.array([m.share for m in self.moments])
        off = np.array([np.zeros(_POSE) if m.off is None else m.off for m in self.moments])
        path = self.path[:, :_POSE]
        poses = path[at] + share[:, None] * (path[at + 1] - path[at]) + off
        for pose, moment in zip(poses, self.moments, strict=True):
            if moment.clear is not None:
                pose[:] = moment.clear
        return poses, share, off
