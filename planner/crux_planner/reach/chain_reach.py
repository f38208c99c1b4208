"""The reach of a limb of any revolute joints, by numeric inverse kinematics: the inner map, angles and links."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.chain import chain_inverse, forward
from crux_planner.model.kinematics import limit_margin
from crux_planner.reach import chain_native, solids
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import HAND, LINK_OF, NOTHING, Links, Solids


@dataclass(frozen=True)
class ChainReach:
    """One limb; see `Reach`. `keep_off` are the shapes of the inner map."""

    limb: Limb
    margin_rad: float
    clear_m: float
    keep_off: Solids = NOTHING

    @cached_property
    def _native(self) -> chain_native.ChainLimb:
        inverse = chain_inverse(self.limb)
        return chain_native.chain_limb(self.limb, inverse, self.margin_rad, self.keep_off, self.clear_m)

    def reaches(self, poses: GripperPoses) -> Flags:
        """Inner map: see `Reach`. By numpy where the compiled one is missing."""
        compiled = chain_native.library()
        if compiled is None:
            return self.reaches_by_numpy(poses)
        return chain_native.reaches(compiled, self._native, poses)

    def reaches_by_numpy(self, poses: GripperPoses) -> Flags:
        """The same."""
        shape = poses.shape
        every = poses.where(np.arange(int(np.prod(shape))))
        q, reached = chain_inverse(self.limb).inverse(*every.in_body())
        near = np.flatnonzero(reached & (limit_margin(self.limb, q) >= self.margin_rad))
        ok = np.zeros(len(q), dtype=bool)
        ok[near] = self._off_trunk(q[near], every.where(near))
        return ok.reshape(shape)

    def angles(self, poses: GripperPoses) -> Array:
        """(..., S): see `Reach`."""
        return chain_inverse(self.limb).inverse(*poses.in_body())[0]

    def cannot(self, low: GripperPoses, high: GripperPoses) -> Flags:
        """Outer map: nothing is certain to be out of reach."""
        return np.zeros(np.broadcast_shapes(low.shape, high.shape), dtype=bool)

    def links(self, poses: GripperPoses) -> Links:
        """See `Reach`; the first link comes last. By numpy where the compiled ones are missing."""
        compiled = chain_native.library()
        if compiled is None:
            return self.links_by_numpy(poses)
        capsules = (*self.keep_off.links, *self.keep_off.first)
        return Links(*chain_native.links(compiled, self._native, poses), *solids.radii_and_hands(capsules))

    def links_by_numpy(self, poses: GripperPoses) -> Links:
        """The same."""
        return self._links(self.angles(poses), poses)

    def _links(self, q_rad: Array, poses: GripperPoses) -> Links:
        zero, placed, (place, hand) = self.limb.at_zero, forward(self.limb.at_zero, q_rad), poses.in_body()
        start, end = [], []
        capsules = (*self.keep_off.links, *self.keep_off.first)
        for each in capsules:
            origin, turn = place, hand
            if each.frame != HAND:
                i = LINK_OF[each.frame]
                origin = placed.points_m[i].T
                turn = np.moveaxis(placed.turns[i], -1, 0) @ zero.rotations[i]
            start.append(origin + turn @ each.start_m)
            end.append(origin + turn @ each.end_m)
        first, last = (
            np.moveaxis(np.array(each).reshape(len(capsules), *poses.shape, 3), 0, -2) for each in (start, end)
        )
        return Links(first, last, *solids.radii_and_hands(capsules))

    def _off_trunk(self, q_rad: Array, poses: GripperPoses) -> Flags:
        """(n,) whether all links keep off the trunk."""
        clear = np.ones(len(q_rad), dtype=bool)
        if not self.keep_off.trunk or not len(q_rad):
            return clear
        return solids.off_trunk(self.keep_off, self._links(q_rad, poses), self.clear_m)
