"""Ranges of angles as comparisons of directions, which need no trigonometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array, Flags


@dataclass(frozen=True)
class Sector:
    """Directions within half an opening of a middle: numbers, or arrays that broadcast."""

    cos_middle: Array | float
    sin_middle: Array | float
    cos_half: Array | float  # 2 where no direction is in it, -2 where all are

    @classmethod
    def between(cls, low_rad: Array | float, high_rad: Array | float) -> Sector:
        """Angles from low to high: none where high is less, all where they are a whole turn apart."""
        low, high = np.asarray(low_rad, dtype=float), np.asarray(high_rad, dtype=float)
        half, middle = (high - low) / 2, (high + low) / 2
        cos_half = np.where(half < 0.0, 2.0, np.where(half >= np.pi, -2.0, np.cos(half)))
        return cls(np.cos(middle), np.sin(middle), cos_half)

    def has(self, x: Array, y: Array, length: Array | float) -> Flags:
        """Whether vectors (x, y) of this length are in it."""
        return np.asarray(self.cos_middle * x + self.sin_middle * y >= self.cos_half * length)
