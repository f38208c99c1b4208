"""What a limb's reach answers, whatever its joints are.

`crux_planner.reach.arm.ArmReach` answers in closed form, for limbs that yaw, pitch and pitch, with a spherical wrist;
`crux_planner.reach.chain_reach.ChainReach` for any other revolute joints.
"""

from __future__ import annotations

from typing import Protocol

from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array, Flags
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import Links, Solids


class Reach(Protocol):
    """One limb of one robot."""

    @property
    def limb(self) -> Limb:
        """Its description."""

    @property
    def keep_off(self) -> Solids:
        """The shapes that keep off each other."""

    def reaches(self, poses: GripperPoses) -> Flags:
        """Inner map, of the poses' shape: joints stay off their limits by a margin, links off the trunk by a clearance.

        True is certain. False may be a pose that the limb reaches with less margin.
        """

    def angles(self, poses: GripperPoses) -> Array:
        """Joint angles (..., J) [rad] of grippers that are reached, those of a stretched limb elsewhere.

        They do not jump between poses: no joint is wrapped.
        """

    def cannot(self, low: GripperPoses, high: GripperPoses) -> Flags:
        """Outer map: True where no pose between `low` and `high` can be had within the joint limits, links off the
        trunk. That is certain. False may be a box of which no pose is reached, the more so the larger it is.
        """

    def links(self, poses: GripperPoses) -> Links:
        """Where the links are at poses (n,) that are reached."""
