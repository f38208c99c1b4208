"""A limb's contacts as a path through windows: it stays on a contact, or takes an arc (a swing) to another one.

With costs for holding and for arcs the cheapest path is exact without branching; the DP of one limb's MIP.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from crux_planner.admm.windows import Arc, Swinging, Windows
from crux_planner.model.arrays import Array, Indices


@dataclass(frozen=True)
class Path:
    """Arcs taken, in the order of time, and what they cost with the stands between them; inf where there is no way."""

    cost: float
    arcs: tuple[int, ...]


@dataclass
class LimbPaths:
    """The paths of limb `limb`."""

    windows: Windows
    limb: int
    _landing: list[Indices] = field(init=False)  # arcs by the window in which they land
    _ends: Indices = field(init=False)  # (3, A): window before, start, goal

    def __post_init__(self) -> None:
        arcs = self.arcs
        self._ends = np.array([[arc.first - 1, arc.start, arc.goal] for arc in arcs], dtype=int).reshape(-1, 3).T
        lands = np.array([arc.end for arc in arcs], dtype=int)
        self._landing = [np.flatnonzero(lands == t) for t in range(self.windows.count)]

    @property
    def arcs(self) -> list[Arc]:
        """Arcs of the limb, as they are numbered in paths."""
        return self.windows.arcs[self.limb]

    def shortest(self, held: Array, arcs: Array) -> Path:
        """The path of least cost; `held` (S, C) a contact through a window, `arcs` (A,). inf forbids."""
        windows = self.windows
        before, start, goal = self._ends
        best = np.full(held.shape, np.inf)
        came = np.full(held.shape, -1)
        begin = windows.problem.start_contacts[self.limb]
        best[0, begin] = held[0, begin]
        for t in range(1, windows.count):
            best[t] = best[t - 1]
            landing = self._landing[t]
            costs = best[before[landing], start[landing]] + arcs[landing]
            for i, cost in zip(landing.tolist(), costs.tolist(), strict=True):
                if cost < best[t, goal[i]]:
                    best[t, goal[i]], came[t, goal[i]] = cost, i
            best[t] += held[t]
        c = min(windows.goals[self.limb], key=lambda end: best[-1, end], default=None)
        if c is None or not np.isfinite(best[-1, c]):
            return Path(np.inf, ())
        cost, taken, t = float(best[-1, c]), list[int](), windows.count - 1
        while t > 0:
            if came[t, c] < 0:
                t -= 1
                continue
            taken.append(int(came[t, c]))
            t, c = int(before[taken[-1]]), int(start[taken[-1]])
        return Path(cost, tuple(taken[::-1]))

    def swings(self, path: Path) -> list[Swinging]:
        """A path's swings at the knots."""
        return [self.windows.swinging(self.limb, self.arcs[i]) for i in path.arcs]
