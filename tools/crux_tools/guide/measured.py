"""What a climbing robot has measured of its map: where the holds are that it grips, and at what friction they slip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import knot_times_s
from crux_contracts.scenario import Scenario, parse_scenario
from crux_contracts.scenario_document import change_friction, foot_of, moved, scenario_document, set_foot
from crux_msgs import limb_knot_t, plan_t, status_t

from crux_tools.guide.situation import IN_PLAN, MEASURED, SHIFT_M, TURN_RAD, shift_of, yaw_of

STANCE = 0  # limb_reference_t.phase


@dataclass(frozen=True)
class Found:
    """A hold that is otherwise than on the map."""

    limb: str
    """that grips it"""
    hold: str
    shift_m: tuple[float, float]
    """of the middle of its foot to where it is, along x and y of W; 0, 0 where that is as on the map"""
    turned_rad: float
    friction: float | None
    """at which it slipped, where that is less than on the map"""

    def __str__(self) -> str:
        off_mm, turned_deg = 1e3 * math.hypot(*self.shift_m), math.degrees(self.turned_rad)
        said = [f"{off_mm:.0f} mm off"] if off_mm else []
        said += [f"turned {turned_deg:+.1f} deg"] if turned_deg else []
        said += [f"friction {self.friction:.2f}"] if self.friction is not None else []
        return f"{self.hold} under {self.limb} {', '.join(said)}"


def interval_of(plan: plan_t, status: status_t) -> int:
    """The interval of the plan in which its clock stands."""
    knot = np.searchsorted(knot_times_s(plan), status.state.plan_time_s + 1e-9) - 1
    return int(np.clip(knot, 0, plan.n_knots - 2))


def found_holds(plan: plan_t, status: status_t) -> list[Found]:
    """The holds under limbs that bear their whole load, where they are otherwise than `plan` has them by more than what
    measuring and yielding make of it.
    """
    here = plan.knots[interval_of(plan, status)]
    found = []
    for limb, name in enumerate(LIMB_NAMES):
        grip, reference, telemetry = here.limbs[limb], status.reference[limb], status.telemetry[limb]
        bears = reference.phase == STANCE and reference.load >= 1.0 and any(telemetry.force_reference_w_n)
        if grip.phase != limb_knot_t.STANCE or grip.hold < 0 or not bears:
            continue
        turned_rad = yaw_of(telemetry, grip.gripper_yaw_w_rad) - grip.gripper_yaw_w_rad
        turned_rad = turned_rad if abs(turned_rad) > TURN_RAD else 0.0
        shift_m = shift_of(plan.holds[grip.hold], grip, telemetry, turned_rad)
        shift_m = shift_m if math.hypot(*shift_m) > SHIFT_M else (0.0, 0.0)
        slipped_at = telemetry.slip_friction
        friction = slipped_at if 0.0 < slipped_at < grip.friction else None
        if any(shift_m) or turned_rad or friction is not None:
            found.append(Found(name, plan.holds[grip.hold].name, shift_m, turned_rad, friction))
    return found


def scenario_with(plan: plan_t, found: Sequence[Found]) -> Scenario:
    """The plan's scenario with these holds as they were found. Raises ScenarioError where that makes none."""
    content = scenario_document(plan.scenario_yaml, IN_PLAN)
    holds = {hold["name"]: hold for hold in content["holds"]}
    for each in found:
        hold = holds[each.hold]
        set_foot(hold, moved(foot_of(hold), each.shift_m, each.turned_rad))
        if each.friction is not None:
            change_friction(hold, partial(min, each.friction))
    return parse_scenario(content, MEASURED)
