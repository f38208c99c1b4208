"""The least that standing costs at a knot of a walk, for multipliers of the centre of pressure and of rising.

With l_i the share of foot i in the normal force, sigma = sum l_i^2 and c_i where it stands, a knot costs at least
    C (gamma + a_z)^2 sigma - square a_z^2 - linear |a_z| - nu a_z - lambda . sum l_i c_i.
Over a_z its least is concave in sigma, so that chords are below it; on a chord the best shares are a projection onto
a simplex. Feet stand anywhere in their ranges, at every knot anew.
"""

import numpy as np

from crux_planner.certificates.bound.centre_of_pressure import CentreOfPressure
from crux_planner.model.arrays import Array, Flags

_CHORDS = np.array([0.0, 0.012, 0.045, 0.13, 1.0])  # where they end, from even shares to one foot alone


def least_loads(
    pressure: CentreOfPressure, multipliers: Array, low: Array, high: Array, on: Flags
) -> tuple[Array, Array]:
    """(N, P): the least for multipliers (N, P, 3) and feet in ranges (P, 4, 2), those that are `on` (P, 4) the ground;
    and about where it is: outputs (N, P, 3).
    """
    multiplier, rising = multipliers[..., :2], multipliers[..., 2]
    up, down = np.maximum(multiplier, 0.0)[..., None, :], np.minimum(multiplier, 0.0)[..., None, :]
    places_gain = (up * high + down * low).sum(axis=-1)
    falling = -np.sort(-np.where(on, places_gain, -np.inf), axis=2)
    linear, square = pressure.remainder(multiplier)
    counts, best = on.sum(axis=1), np.empty(rising.shape)
    for count in np.unique(counts):
        own = np.flatnonzero(counts == count)
        slope, begin = _chords(pressure, rising[:, own], linear[:, own], square[:, own], int(count))
        best[:, own] = _shared(falling[:, own, : int(count)], slope, begin)
    shares, rise = _shares(pressure, rising, places_gain, on, square)
    places = np.where(multiplier[..., None, :] > 0, high, low)
    return best, np.concatenate([(shares[..., None] * places).sum(axis=-2), rise[..., None]], axis=-1)


def _chords(pressure: CentreOfPressure, rising: Array, linear: Array, square: Array, count: int) -> tuple[Array, Array]:
    """Slope and value at sigma = 0 (..., chords) of chords below the least over a_z, a function of sigma."""
    sigma = 1 / count + (1 - 1 / count) * _CHORDS
    value = least_rising(pressure, rising[..., None], linear[..., None], square[..., None], sigma)
    slope = np.diff(value, axis=-1) / np.diff(sigma)
    return slope, value[..., :-1] - slope * sigma[:-1]


def least_rising(
    pressure: CentreOfPressure, rising: Array, linear: Array | float, square: Array | float, sigma: Array
) -> Array:
    """Least over |a_z| <= A of C (gamma + a_z)^2 sigma - square a_z^2 - linear |a_z| - rising a_z."""
    bend, most = pressure.effort * sigma - square, pressure.most_rising
    lean = 2 * pressure.effort * pressure.gamma * sigma - rising
    best = np.zeros(bend.shape)
    for sign in (1.0, -1.0):
        steep = sign * lean - linear  # along |a_z|
        inside = np.clip(-steep / (2 * np.maximum(bend, 1e-12)), 0.0, most)
        best = np.minimum(best, (bend * inside + steep) * inside)
        best = np.minimum(best, (bend * most + steep) * most)
    return np.asarray(best + pressure.effort * pressure.gamma**2 * sigma)


def _shared(gains: Array, slope: Array, begin: Array) -> Array:
    """Least over chords and over shares of slope sigma + begin - sum l_i gain_i; gains (..., feet) fall, and the
    chords are the last axis of slope and begin.
    """
    first, second = np.cumsum(gains, axis=-1), np.cumsum(gains**2, axis=-1)
    value = begin + slope - gains[..., :1]
    for m in range(2, gains.shape[-1] + 1):
        excess = (first[..., m - 1 : m] / (2 * slope) - 1.0) / m
        shared = begin - second[..., m - 1 : m] / (4 * slope) + m * slope * excess**2
        value = np.where(gains[..., m - 1 : m] > 2 * slope * excess, shared, value)
    return np.asarray(value.min(axis=-1))


def _shares(pressure: CentreOfPressure, rising: Array, gains: Array, on: Flags, square: Array) -> tuple[Array, Array]:
    """About the best shares and a_z: with the slope in sigma as it is where they are."""
    most, sigma = pressure.most_rising, np.broadcast_to(1.0 / on.sum(axis=1), rising.shape)
    for _ in range(2):
        lean = rising - 2 * pressure.effort * pressure.gamma * sigma
        rise = np.clip(lean / (2 * np.maximum(pressure.effort * sigma - square, 1e-9)), -most, most)
        shares = _projected(gains / (2 * pressure.effort * (pressure.gamma + rise) ** 2)[..., None], on)
        sigma = (shares**2).sum(axis=-1)
    return shares, rise


def _projected(point: Array, on: Flags) -> Array:
    """The nearest shares (..., 4): not negative, one in sum, none of feet in the air."""
    point = np.where(on, point, -1e9)
    falling = -np.sort(-point, axis=-1)
    theta = (np.cumsum(falling, axis=-1) - 1.0) / np.arange(1, 5)
    last = (falling > theta).sum(axis=-1, keepdims=True) - 1
    return np.asarray(np.maximum(point - np.take_along_axis(theta, last, axis=-1), 0.0))
