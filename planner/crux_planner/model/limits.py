"""What of a robot bounds swings."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SwingLimits:
    """What bounds a swing."""

    dt_s: float
    speed_m_s: float
    yaw_rate_rad_s: float
    clearance_m: float  # of the middle of a finger to cuboids
    body_clearance_m: float  # of palms and fingers among grippers and beside tall cuboids
    max_height_m: float  # of a pad above the wall
