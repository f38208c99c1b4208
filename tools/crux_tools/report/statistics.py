"""Rates and what is known of them: 95 % intervals.

Sources: Wilson (1927), by SciPy; Newcombe, Statistics in Medicine 17 (1998) 873, method 10; Bonett and Price, British
Journal of Mathematical and Statistical Psychology 65 (2012) 479.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate with its bounds."""

    value: float
    low: float
    high: float

    def percent(self) -> str:
        """For people."""
        return f"{100 * self.value:.1f} % ({100 * self.low:.1f} to {100 * self.high:.1f} %)"


@dataclass(frozen=True)
class Rate:
    """So many of so many."""

    good: int
    of: int

    @property
    def interval(self) -> Interval:
        """Wilson's."""
        from scipy.stats import binomtest

        if self.of == 0:
            return Interval(0.0, 0.0, 1.0)
        bounds = binomtest(self.good, self.of).proportion_ci(CONFIDENCE, method="wilson")
        return Interval(self.good / self.of, float(bounds.low), float(bounds.high))

    def __str__(self) -> str:
        """For people."""
        return f"{self.good} of {self.of}: {self.interval.percent()}" if self.of else "none"


def difference(before: Rate, after: Rate) -> Interval:
    """after - before of independent samples, by Newcombe from Wilson's intervals."""
    a, b = before.interval, after.interval
    value = b.value - a.value
    low = value - sqrt((b.value - b.low) ** 2 + (a.high - a.value) ** 2)
    return Interval(value, low, value + sqrt((b.high - b.value) ** 2 + (a.value - a.low) ** 2))


def paired_difference(lost: int, won: int, pairs: int) -> Interval:
    """(won - lost) / pairs, where `lost` were good before alone and `won` after alone, by Bonett and Price."""
    from scipy.stats import norm

    p_won, p_lost = (won + 1) / (pairs + 2), (lost + 1) / (pairs + 2)
    half = norm.ppf((1 + CONFIDENCE) / 2) * sqrt((p_won + p_lost - (p_won - p_lost) ** 2) / (pairs + 2))
    low, high = max(p_won - p_lost - half, -1.0), min(p_won - p_lost + half, 1.0)
    return Interval((won - lost) / max(pairs, 1), float(low), float(high))
