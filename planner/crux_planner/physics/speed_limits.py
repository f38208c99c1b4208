"""How slow the body must be: between two knots the wrenches lag behind a body that moves.

On weak supports the corrections that make up for the lag leave the limit surface; they grow with the way of the body
in one interval. For grips that carry no shear at all this is foreseen; else it is learnt from the check. What is known
is kept per set of contacts, so that other sequences over the same stances know it too.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.schedule import Contacts, SpeedLimits
from crux_planner.solvers.sparse_blocks import skews

WANTED_N = 0.3  # of excess at most; the check forgives a little more


def steady_speed(contacts: Sequence[Contact], weight_N: Array, dt_s: float, held: Contacts) -> float:
    """Largest body speed [m/s] at which grips among `held` that carry no shear are asked for next to none.

    A body that is d further than its wrenches know lacks the moment weight x d. The controller adds the least forces
    f_i = (J^-1 (weight x d)) x p_i that make up for it, p_i the grips' places about their middle, J the sum of
    |p_i|^2 I - p_i p_i^T.
    """
    grips = [contacts[c] for c in held if c is not None and contacts[c].bears]
    slippery = [g.slippery for g in grips]
    if not any(slippery):
        return float(np.inf)
    places = np.stack([g.centre_h_m for g in grips])
    places -= places.mean(axis=0)
    about = (places**2).sum() * np.eye(3) - places.T @ places
    turn = np.linalg.pinv(about) @ skews(weight_N)
    most = 0.0
    for grip, place, slips in zip(grips, places, slippery, strict=True):
        if slips:
            shear = (np.eye(3) - np.outer(grip.axis, grip.axis)) @ -skews(place) @ turn / 2  # of one finger, per metre
            most = max(most, float(np.linalg.norm(shear, 2)))
    return WANTED_N / (most * dt_s) if most > 0.0 else float(np.inf)


def foreseen(
    contacts: Sequence[Contact], weight_N: Array, dt_s: float, stances: Iterable[Contacts]
) -> dict[Contacts, float]:
    """The speeds of those `stances` that need to be slow."""
    known = {held: steady_speed(contacts, weight_N, dt_s, held) for held in set(stances)}
    return {held: speed for held, speed in known.items() if np.isfinite(speed)}


def speeds(speed_limits: SpeedLimits, contacts: list[list[int | None]], most_m_s: float) -> Array:
    """(N + 1,) largest body speed at the knots."""
    return np.array([min(speed_limits.get(tuple(held), most_m_s), most_m_s) for held in contacts])
