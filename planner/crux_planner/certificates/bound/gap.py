"""The gap of a plan."""

from __future__ import annotations

import numpy as np


def gap(cost: float, bound: float | None) -> float | None:
    """How far above the bound a cost may be, as a share of it: (cost - bound) / cost; None without a bound."""
    if bound is None or not np.isfinite(bound) or cost <= 0.0:
        return None
    return max((cost - bound) / cost, 0.0)
