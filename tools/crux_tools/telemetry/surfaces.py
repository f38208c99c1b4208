"""The surfaces of a plan's wall, and what of pads bears on its holds, from the scenario that it carries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from crux_contracts.scenario import Slab, Wall, parse_scenario
from crux_msgs import hold_t


def wall_of(plan: Any) -> Wall:
    """Of a plan_t."""
    return parse_scenario(plan.scenario_yaml, any_robot=True).wall


def pad_shares_of(plan: Any) -> list[tuple[float, ...]]:
    """Of each hold and obstacle of a plan_t, by its faces (+x, -x, +y, -y, top): what of a pad bears there."""
    holds = parse_scenario(plan.scenario_yaml, any_robot=True).holds
    known = {hold.name: (*hold.pad_share, 1.0) for hold in holds}
    return [known.get(hold.name, (1.0,) * 5) for hold in plan.holds]


def box(foot_w_m: Sequence[float], size_m: Sequence[float], name: str = "") -> hold_t:
    """An upright solid, as plans have obstacles."""
    made = hold_t()
    made.name, made.position_w_m, made.size_m = name, list(foot_w_m), list(size_m)
    return made


def box_of(slab: Slab) -> hold_t:
    """The solid behind a bounded surface."""
    made = box((*slab.position_m, slab.foot_z_m), slab.size_m, slab.name)
    made.yaw_rad, made.tilt_rad = slab.yaw_rad, list(slab.tilt_rad)
    return made
