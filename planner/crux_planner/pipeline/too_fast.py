"""Plans that the check refuses because the body moves too far between two knots, and how slow it must be instead."""

from __future__ import annotations

import numpy as np

from crux_planner.checker import CheckReport
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.schedule import Contacts, SpeedLimits
from crux_planner.physics.speed_limits import WANTED_N

BETWEEN_KNOTS = "limit_surface_between_knots"
_LEAST_CUT = 0.8  # of the speed is left at most, so that every cut counts
_BEGUN, _BLENDED = 0.1, 0.45  # of an interval: its own motion counts from, that of the one before to
_STILL_M_S = 1e-4  # slower is no motion


class TooFast(InfeasibleError):
    """A plan that the check refuses for what happens between its knots; with `speed_limits` it may pass."""

    def __init__(self, refused: InfeasibleError, speed_limits: SpeedLimits) -> None:
        super().__init__(refused.constraint, str(refused))
        self.speed_limits = speed_limits


def slowed(
    speed_limits: SpeedLimits, report: CheckReport, contacts: list[list[int | None]], speed_m_s: Array, dt_s: float
) -> dict[Contacts, float] | None:
    """`speed_limits` with the speeds that the report asks for; None where more than slowness is wanted.

    `contacts` and `speed_m_s` (N + 1,), the largest component of the body's velocity, are those of the plan's knots.
    """
    cut = dict(speed_limits)
    for violation in report.violations:
        if violation.constraint != BETWEEN_KNOTS or violation.time_s is None:
            return None
        k = min(int(violation.time_s / dt_s + 1e-9), len(speed_m_s) - 2)
        share = violation.time_s / dt_s - k
        at = [j for j in (k - 1, k) if j >= 0 and (share < _BLENDED if j < k else share > _BEGUN)]
        fastest = float(np.max(speed_m_s[at]))
        if fastest < _STILL_M_S:
            return None
        allowed = fastest * min(WANTED_N / violation.amount, _LEAST_CUT)
        for j in at:
            held = tuple(contacts[j])
            cut[held] = min(cut.get(held, np.inf), allowed)
    return cut
