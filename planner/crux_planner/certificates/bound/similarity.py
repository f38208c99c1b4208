"""Sets of grasps that are alike: what one teaches about the multiplier of force and moment holds nearly for the others.

Multipliers about a point of the body's frame say the same of a set of grasps and of its copy elsewhere on the wall. So
the multipliers of a few sets, each taken to where the others are, bound the cost of all: whether they are good
multipliers for a set decides how tight the bound is, not whether it holds.
"""

import numpy as np

from crux_planner.certificates.bound.grasps import Grasps
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem

_LENGTH_M = 0.1  # that much farther apart is as unlike as
_AIR = 3.0  # a limb in the air instead of on a contact, times this


class Similarity:
    """How nodes look from where the body would stand."""

    def __init__(self, problem: Problem, nodes: Grasps) -> None:
        last = np.append(nodes.first[1:], len(nodes.node))
        levels = (nodes.first + last) // 2  # cells are in the order of yaw: about the middle one
        self.middle_m = np.clip(problem.goal.body.position_m, nodes.low[levels], nodes.high[levels])
        looks = []
        for limb, groups in enumerate(nodes.groups):
            own = [problem.contacts[group[0]] for group in groups]
            places = np.array([c.centre_h_m for c in own] + [np.zeros(3)])
            kinds = [[np.cos(2 * c.yaw_rad), np.sin(2 * c.yaw_rad), c.grip_friction.min()] for c in own]
            options = nodes.options[:, limb]
            air = options == len(groups)
            kind = np.array([*kinds, [0.0] * 3])[options]
            look = np.column_stack([(places[options] - self.middle_m) / _LENGTH_M, kind])
            look[air] = 0.0
            looks.append(np.column_stack([look, _AIR * air]))
        self._looks = np.hstack(looks).astype(np.float32)

    def nearest(self, nodes: Indices, to: Indices) -> Indices:
        """For each of `nodes`, which one of the nodes `to` it is most like, as a place in `to`."""
        mine, theirs = self._looks[nodes], self._looks[to]
        return np.asarray(((theirs**2).sum(axis=1) - 2 * mine @ theirs.T).argmin(axis=1))

    def taken_to(self, multipliers: Array, source: Indices | int, target: Indices) -> Array:
        """Multipliers (6,) or (n, 6) of nodes `source` about the origin, as they are at the nodes `target` (n, 6)."""
        multipliers = np.broadcast_to(multipliers, (len(target), 6))
        moved = multipliers[:, :3] + np.cross(multipliers[:, 3:], self.middle_m[source] - self.middle_m[target])
        return np.hstack([moved, multipliers[:, 3:]])
