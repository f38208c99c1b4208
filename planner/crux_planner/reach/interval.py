"""Interval arithmetic on arrays: from where its parts are, where a number is for certain.

Each operation is as tight as it can be by itself; what occurs twice in an expression counts twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array, Flags

ROUNDING = 1e-9  # more than what rounding makes of any of these numbers: comparisons forgive it


@dataclass(frozen=True, eq=False)
class Interval:
    """Numbers from low to high: arrays that broadcast."""

    low: Array
    high: Array

    def __add__(self, other: Interval | float) -> Interval:
        """Sum."""
        if isinstance(other, Interval):
            return Interval(self.low + other.low, self.high + other.high)
        return Interval(self.low + other, self.high + other)

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Interval | float) -> Interval:
        """Difference."""
        return self + (-other)

    def __mul__(self, other: Interval | float) -> Interval:
        """Product."""
        if isinstance(other, Interval):
            parts = (self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high)
            return _around(*parts)
        return _around(self.low * other, self.high * other)

    @property
    def size(self) -> Interval:
        """Absolute value."""
        least = np.maximum(np.maximum(self.low, -self.high), 0.0)
        return Interval(least, np.maximum(np.abs(self.low), np.abs(self.high)))

    @property
    def squared(self) -> Interval:
        """Square: not below 0, as a product might be."""
        size = self.size
        return Interval(size.low**2, size.high**2)

    @property
    def root(self) -> Interval:
        """Square root of what is not negative."""
        return Interval(np.sqrt(self.low), np.sqrt(self.high))

    def clipped(self, low: float, high: float) -> Interval:
        """The nearest numbers within bounds."""
        return Interval(np.clip(self.low, low, high), np.clip(self.high, low, high))

    def meets(self, low: float, high: float) -> Flags:
        """Where some of it is within bounds."""
        return np.asarray((self.low <= high + ROUNDING) & (self.high >= low - ROUNDING))

    def meets_turned(self, low: float, high: float) -> tuple[Flags, Interval]:
        """Where some of it is within bounds after whole turns, and what of the bounds that is, as one interval."""
        turn = 2 * np.pi
        first = np.ceil((low - self.high - ROUNDING) / turn)
        one = first == np.floor((high - self.low + ROUNDING) / turn)
        meets = first <= np.floor((high - self.low + ROUNDING) / turn)
        moved = Interval(self.low + turn * first, self.high + turn * first).clipped(low, high)
        return np.asarray(meets), Interval(np.where(one, moved.low, low), np.where(one, moved.high, high))


def cosine(angle: Interval) -> Interval:
    """Of angles [rad]."""
    ends = np.cos(angle.low), np.cos(angle.high)
    turn = 2 * np.pi
    top = np.floor(angle.high / turn) >= np.ceil(angle.low / turn)
    bottom = np.floor((angle.high - np.pi) / turn) >= np.ceil((angle.low - np.pi) / turn)
    return Interval(np.where(bottom, -1.0, np.minimum(*ends)), np.where(top, 1.0, np.maximum(*ends)))


def sine(angle: Interval) -> Interval:
    """Of angles [rad]."""
    return cosine(angle - np.pi / 2)


def direction(x: Interval, y: Interval) -> Interval:
    """Angles [rad] of the vectors of a rectangle, which may go beyond pi; a whole turn where 0 is in it."""
    middle = np.arctan2((y.low + y.high) / 2, (x.low + x.high) / 2)
    corners = [np.arctan2(b, a) - middle for a in (x.low, x.high) for b in (y.low, y.high)]
    off = _around(*[np.remainder(corner + np.pi, 2 * np.pi) - np.pi for corner in corners])
    all_ = x.meets(0.0, 0.0) & y.meets(0.0, 0.0)
    return Interval(middle + np.where(all_, -np.pi, off.low), middle + np.where(all_, np.pi, off.high))


def _around(*values: Array) -> Interval:
    low, high = values[0], values[0]
    for value in values[1:]:
        low, high = np.minimum(low, value), np.maximum(high, value)
    return Interval(low, high)
