"""How slow the body must be, learnt from the check: between two knots the wrenches lag behind a body that moves.

On weak supports the corrections that make up for the lag leave the limit surface; they grow with the way of the body
in one interval. What is learnt is kept per set of contacts, so that other sequences over the same stances know it too.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crux_planner.arrays import Array
from crux_planner.checker import CheckReport
from crux_planner.errors import InfeasibleError

Contacts = tuple[int | None, ...]
"""Of every limb, None in the air."""
Calm = Mapping[Contacts, float]
"""Largest body speed [m/s] while exactly these contacts are held."""

BETWEEN_KNOTS = "limit_surface_between_knots"
_WANTED_N = 0.3  # of excess at most after a cut; the check forgives a little more
_LEAST_CUT = 0.8  # of the speed is left at most, so that every cut counts
_BEGUN, _BLENDED = 0.1, 0.45  # of an interval: its own motion counts from, that of the one before to
_STILL_M_S = 1e-4  # slower is no motion


class TooHasty(InfeasibleError):
    """A plan that the check refuses for what happens between its knots; with `calm` it may pass."""

    def __init__(self, refused: InfeasibleError, calm: Calm) -> None:
        super().__init__(refused.constraint, str(refused))
        self.calm = calm


def slowed(
    calm: Calm, report: CheckReport, contacts: list[list[int | None]], speed_m_s: Array, dt_s: float
) -> dict[Contacts, float] | None:
    """`calm` with the speeds that the report asks for; None where more than slowness is wanted.

    `contacts` and `speed_m_s` (N + 1,), the largest component of the body's velocity, are those of the plan's knots.
    """
    cut = dict(calm)
    for violation in report.violations:
        if violation.constraint != BETWEEN_KNOTS or violation.time_s is None:
            return None
        k = min(int(violation.time_s / dt_s + 1e-9), len(speed_m_s) - 2)
        share = violation.time_s / dt_s - k
        at = [j for j in (k - 1, k) if j >= 0 and (share < _BLENDED if j < k else share > _BEGUN)]
        fastest = float(np.max(speed_m_s[at]))
        if fastest < _STILL_M_S:
            return None
        allowed = fastest * min(_WANTED_N / violation.amount, _LEAST_CUT)
        for j in at:
            held = tuple(contacts[j])
            cut[held] = min(cut.get(held, np.inf), allowed)
    return cut


def speeds(calm: Calm, contacts: list[list[int | None]], most_m_s: float) -> Array:
    """(N + 1,) largest body speed at the knots."""
    return np.array([min(calm.get(tuple(held), most_m_s), most_m_s) for held in contacts])
