"""A running plan on a map whose holds turn out to lie elsewhere: each grip goes with its hold, swings in between."""

from __future__ import annotations

import math

import numpy as np
from crux_contracts.scenario import Scenario
from crux_msgs import hold_t, limb_knot_t, plan_t

from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_z

_SAME = 1e-9  # m, rad: what lies within is where it was


def on_moved_holds(running: plan_t, scenario: Scenario) -> plan_t:
    """`running` with its grips where `scenario` has the holds of the same names, turned as these are; the same plan
    where none has moved. Wrenches, body and times stay, so that it is where a plan on that map is looked for, and none
    that holds there by itself.
    """
    moved = {i: _Moved(hold, scenario) for i, hold in enumerate(running.holds) if _has_moved(hold, scenario)}
    if not moved:
        return running
    plan = plan_t.decode(running.encode())
    for limb in range(len(plan.knots[0].limbs)):
        grips = [knot.limbs[limb] for knot in plan.knots]
        held = [grip.hold for grip in grips]
        for k, grip in enumerate(grips):
            _move(grip, [(moved.get(hold), share) for hold, share in _between(held, k)])
    return plan


class _Moved:
    """A hold that lies elsewhere than in a plan."""

    def __init__(self, hold: hold_t, scenario: Scenario) -> None:
        there = scenario.holds[scenario.hold_index(hold.name)]
        self.was_m, self.is_m = np.array(hold.position_w_m[:2]), np.array(there.position_m[:2])
        self.turned_rad = math.remainder(there.yaw_rad - hold.yaw_rad, math.tau)

    def way_m(self, place_m: Array) -> Array:
        """(2,) by which a place that goes with the hold moves along the wall."""
        c, s = math.cos(self.turned_rad), math.sin(self.turned_rad)
        seen = place_m - self.was_m
        turned: Array = np.array([c * seen[0] - s * seen[1], s * seen[0] + c * seen[1]])
        return np.asarray(self.is_m + turned - place_m)


def _has_moved(hold: hold_t, scenario: Scenario) -> bool:
    if not hold.graspable or hold.name not in [each.name for each in scenario.holds]:
        return False
    moved = _Moved(hold, scenario)
    return bool(np.abs(moved.is_m - moved.was_m).max() > _SAME or abs(moved.turned_rad) > _SAME)


def _between(held: list[int], k: int) -> list[tuple[int, float]]:
    """The holds with which a gripper goes at knot k, by their shares: its own, or in the air the one that it has left
    and the one that it comes to. `held`: its holds at all knots, -1 in the air.
    """
    if held[k] >= 0:
        return [(held[k], 1.0)]
    first = last = k
    while first > 0 and held[first - 1] < 0:
        first -= 1
    while last + 1 < len(held) and held[last + 1] < 0:
        last += 1
    share = (k - first) / (last - first) if last > first else 1.0
    left = held[first - 1] if first > 0 else -1
    comes = held[last + 1] if last + 1 < len(held) else -1
    return [(left, 1.0 - share), (comes, share)]


def _move(grip: limb_knot_t, ways: list[tuple[_Moved | None, float]]) -> None:
    place, yaw_rad, tilt_rad = (
        list(grip.gripper_position_w_m),
        grip.gripper_yaw_w_rad,
        np.array(grip.gripper_tilt_w_rad),
    )
    here = np.array(place[:2])
    for moved, share in ways:
        if moved is not None:
            way_m = share * moved.way_m(here)
            place = [place[0] + float(way_m[0]), place[1] + float(way_m[1]), place[2]]
            yaw_rad += share * moved.turned_rad
            tilt_rad = rotation_z(share * moved.turned_rad)[:2, :2] @ tilt_rad
    grip.gripper_position_w_m, grip.gripper_yaw_w_rad, grip.gripper_tilt_w_rad = place, yaw_rad, tilt_rad.tolist()
