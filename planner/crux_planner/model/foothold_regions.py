"""Where feet may stand beside obstacles: a foot stays on one side of each, or goes along one side and then another.

Steps lead straight from foothold to foothold, so that a step whose two ends are on one side of an obstacle does not
pass over it. Sides are along and across the first heading. A foot that cannot go on past the side on which it begins
makes its first step to where that side and the next one meet; where the goal is beyond the obstacle rather than beside
it, the foot comes back by its last two steps, from where the next side and the far one meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Obstacle

from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.cuboids import cuboids_of
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.shapes import palm_shape

CLEARANCE_M = 0.012  # of a standing gripper: in the air it is off its way by 8 mm


Bounds = tuple[Array, Array]
"""Lower and upper bounds (4, 2) of a foothold of each foot."""


@dataclass(frozen=True)
class FootholdRanges:
    """Bounds of each foot's first foothold, those on the way, the last but one, and the last, of three steps or more;
    of two steps the first and the last but one; all four are the same for a foot that needs no detour.

    `fewest` (4,) steps does a foot need for its detour; the steps but for `fewest` - 1 of them lead `passing_m` (4,) on
    in all.
    """

    first: Bounds
    along: Bounds
    passing: Bounds
    last: Bounds
    fewest: Indices
    passing_m: Array

    def of_steps(self, limb: int, steps: int) -> tuple[Array, Array] | None:
        """Lower and upper bounds (steps, 2) of a foot's footholds; None where it takes too few steps."""
        if steps < self.fewest[limb]:
            return None
        in_turn = {1: [self.last], 2: [self.first, self.passing]}.get(
            steps, [self.first, *[self.along] * (steps - 3), self.passing, self.last]
        )
        return np.array([low[limb] for low, _ in in_turn]), np.array([high[limb] for _, high in in_turn])


def foothold_ranges(
    obstacles: Sequence[Obstacle],
    robot: Robot,
    heading_rad: float,
    yaw_rad: float,
    feet: Array,
    wanted: Array,
    slack_m: Array,
) -> FootholdRanges:
    """In the frame that is turned by `heading_rad`.

    Feet (4, 2) are where they stand, `wanted` (4, 2) where they would be at the goal, turned by up to `yaw_rad` on the
    way; `slack_m` (2,) is how far from there a foot may end. Raises InfeasibleError for a foot that stands at an
    obstacle, or has no way past one.
    """
    first, along, passing, last = stages = [(np.full((4, 2), -np.inf), np.full((4, 2), np.inf)) for _ in range(4)]
    ranges = FootholdRanges(first, along, passing, last, np.ones(4, dtype=int), np.zeros(4))
    reach = _reach(robot, yaw_rad) + CLEARANCE_M
    for obstacle in obstacles:
        middle, edges = cuboids_of([obstacle], heading_rad).outline
        centre, turned = middle[0], np.abs(rotation_z(obstacle.yaw_rad - heading_rad)[:2, :2])
        half = turned @ edges[0] + reach
        for limb, name in enumerate(LIMB_NAMES):
            # by how much the start is outside of each side, and the goal inside; (2, 2): lower and upper, axis
            outside = np.array([centre - half - feet[limb], feet[limb] - centre - half])
            inside = np.array([wanted[limb] - centre + half, centre + half - wanted[limb]])
            if outside.max() < 0.0:
                text = f"start.feet.{name} is {-1000 * outside.max():.0f} mm too near to obstacle {obstacle.name!r}"
                raise InfeasibleError("contacts", f"{text} for its gripper")
            begins = _side(np.where(outside >= 0.0, inside, np.inf))
            if inside[begins] <= slack_m[begins[1]]:
                for stage in stages:
                    _keep(stage, limb, begins, centre, half)
                continue
            across = np.full((2, 2), np.inf)
            across[:, 1 - begins[1]] = inside[:, 1 - begins[1]]
            then, beyond = _side(across), (1 - begins[0], begins[1])
            back = max(inside[beyond], 0.0) < across[then] and inside[beyond] <= slack_m[begins[1]]
            # on the way, the body may be as far off its way as the foot off its place
            if across[then] > (2 if back else 1) * slack_m[then[1]]:
                text = f"no foothold for {name} beside obstacle {obstacle.name!r}"
                raise InfeasibleError("contacts", f"{text} {'on the way' if back else 'at the goal'}")
            _keep(first, limb, begins, centre, half)
            for stage in (first, along, passing) if back else stages:
                _keep(stage, limb, then, centre, half)
            for stage in (passing, last) if back else ():
                _keep(stage, limb, beyond, centre, half)
            way = 2 * half[begins[1]] if back else inside[begins]
            ranges.fewest[limb] = max(ranges.fewest[limb], 3 if back else 2)
            ranges.passing_m[limb] = max(ranges.passing_m[limb], way)
    for low, high in stages:
        for name in (LIMB_NAMES[i] for i in np.flatnonzero((low > high).any(axis=1))):
            raise InfeasibleError("contacts", f"no foothold for {name} between the obstacles")
    return ranges


def _side(inside: Array) -> tuple[int, int]:
    """The side that asks least: 0 for the lower and 1 for the upper, and its axis."""
    side, axis = np.unravel_index(int(np.argmin(inside)), (2, 2))
    return int(side), int(axis)


def _keep(ranges: Bounds, limb: int, side: tuple[int, int], centre: Array, half: Array) -> None:
    """Narrow the ranges of a foot to one side."""
    upper, axis = side
    low, high = ranges
    if upper:
        low[limb, axis] = max(low[limb, axis], centre[axis] + half[axis])
    else:
        high[limb, axis] = min(high[limb, axis], centre[axis] - half[axis])


def _reach(robot: Robot, yaw_rad: float) -> Array:
    """(2,): how far a gripper with its fingers closed reaches along and across, turned by up to an angle."""
    palm = palm_shape(robot)
    fingers = np.array([robot.gripper.opening_m[0] + 2 * robot.gripper.pad_radius_m, robot.gripper.pad_radius_m])
    size = fingers if palm is None else np.maximum(fingers, [palm.half_length, palm.half_width])
    return np.asarray(size + np.sin(abs(yaw_rad)) * size[::-1])
