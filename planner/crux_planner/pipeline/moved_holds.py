"""A running plan on a map whose holds turn out to lie elsewhere: each grip goes with its hold, swings in between."""

from __future__ import annotations

import math

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_contracts.scenario import Scenario
from crux_msgs import hold_t, limb_knot_t, plan_t

from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_from_rpy

_SAME = 1e-9  # m, rad: what lies within is where it was


def on_moved_holds(running: plan_t, scenario: Scenario) -> plan_t:
    """`running` with its grips where `scenario` has the holds of the same names, turned as these are; the same plan
    where none has moved. Wrenches, body and times stay, so that it is where a plan on that map is looked for, and none
    that holds there by itself.
    """
    if not (moved := _moved(running, scenario)):
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
        was = rotation_from_rpy(np.array([*hold.tilt_rad, hold.yaw_rad]))
        self.was_m, self.is_m = np.array(hold.position_w_m), np.array([*there.position_m, there.foot_z_m])
        self.turn = rotation_from_rpy(np.array([*there.tilt_rad, there.yaw_rad])) @ was.T

    @property
    def has_moved(self) -> bool:
        """Whether it is not where it was."""
        return bool(max(np.abs(self.is_m - self.was_m).max(), np.abs(self.turn - np.eye(3)).max()) > _SAME)

    def way(self, grip: Array) -> Array:
        """(6,) by which a gripper (6,) that goes with the hold moves: place, yaw and tilt."""
        place_m = self.is_m + self.turn @ (grip[:3] - self.was_m)
        yaw_rad, tilt_rad = yaw_and_tilt(self.turn @ gripper_rotation(grip[3], grip[4:]))
        return np.array([*(place_m - grip[:3]), math.remainder(yaw_rad - grip[3], math.tau), *(tilt_rad - grip[4:])])


def _moved(running: plan_t, scenario: Scenario) -> dict[int, _Moved]:
    """The holds of a plan that the scenario has elsewhere, by their numbers."""
    known = {hold.name for hold in scenario.holds}
    found = {i: _Moved(hold, scenario) for i, hold in enumerate(running.holds) if hold.graspable and hold.name in known}
    return {i: hold for i, hold in found.items() if hold.has_moved}


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
    here = np.array([*grip.gripper_position_w_m, grip.gripper_yaw_w_rad, *grip.gripper_tilt_w_rad])
    for moved, share in ways:
        if moved is not None:
            here = here + share * moved.way(here)
    grip.gripper_position_w_m, grip.gripper_tilt_w_rad = here[:3].tolist(), here[4:].tolist()
    grip.gripper_yaw_w_rad = float(here[3])
