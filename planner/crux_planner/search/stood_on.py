"""Where a level body may be on a stance, for estimates: about the poses that the map has, not all that the hulls of its
limbs' reach have in common.
"""

from __future__ import annotations

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Stance
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.search.map_search import MapSearch


class StoodOn(ReachableSet):
    """Of a problem whose reach are hulls: on each stance, what they and the extent of its poses on the map share."""

    def __init__(self, problem: Problem, search: MapSearch) -> None:
        super().__init__(problem)
        self.usable = problem.limb_contacts  # the map knows which headings each of them asks for
        self._search, self._known = search, dict[Stance, tuple[Array, Array] | None]()
        grid = search.masks.grid
        half_m = [float(axis[1] - axis[0]) / 2 if len(axis) > 1 else 0.0 for axis in (grid.x_m, grid.y_m, grid.z_m)]
        self._half_m = np.abs(problem.boxes.directions) @ half_m  # of a cell

    def of(self, stance: Stance) -> tuple[Array, Array] | None:
        """As of all that hulls have in common; None, too, where the map has no pose."""
        if stance not in self._known:
            self._known[stance] = self._stood(stance)
        return self._known[stance]

    def may_end(self, stance: Stance) -> bool:
        """Whether all limbs hold on to a stance together with the body at the goal, off each other."""
        return bool((self._search.goals == stance).all(axis=1).any())

    def _stood(self, stance: Stance) -> tuple[Array, Array] | None:
        hulls = super().of(stance)
        places = None if hulls is None else np.argwhere(self._search.poses(stance).any(axis=(0, 1, 2)))
        if hulls is None or places is None or not len(places):
            return None
        grid = self._search.masks.grid
        z, x, y = (axis[places[:, i]] for i, axis in enumerate((grid.z_m, grid.x_m, grid.y_m)))
        along = np.column_stack([x, y, z]) @ self.shape.directions.T
        low, high = along.min(axis=0) - self._half_m, along.max(axis=0) + self._half_m
        return np.maximum(hulls[0], low), np.minimum(hulls[1], high)
