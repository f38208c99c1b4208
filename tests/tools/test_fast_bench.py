"""`crux bench fast`: the walls it draws, and when its climbs are well."""

from __future__ import annotations

from typing import Any

import pytest
from crux_contracts.scenario import parse_scenario
from crux_simulation.benchmarks.fast_climbs import is_well, line_of, wall_of


def row(verdict: str = "climbed", slips: int = 0, fell: bool = False, force_N: float = 1.0) -> dict[str, Any]:
    tracking = {"force_N": force_N, "body_m": 0.002}
    climb = {"slips": slips, "fell": fell, "lost_grips": [], "tracking": tracking, "m_min": 0.6, "margin": 0.5}
    return {"verdict": verdict, "reason": "", "climb": climb}


def test_walls_are_planned_for_the_least_time_and_drawn_by_their_seed() -> None:
    for seed, kind in ((8, "wall"), (9, "ladder")):
        drawn, wall = wall_of(seed, "time")
        scenario = parse_scenario(wall.scenario())
        assert (drawn, scenario.planner.objective) == (kind, "time")
        assert wall_of(seed, "time") == (drawn, wall)
        assert wall_of(seed + 4, "time")[1].text != wall.text


@pytest.mark.parametrize(
    ("other", "as_planned", "in_a_world"),
    [
        (row(), True, True),
        (row(slips=1), False, False),
        (row("failed", fell=True), False, False),
        (row("failed"), False, False),
        (row(force_N=1.6), False, True),
    ],
)
def test_one_climb_in_thirty_that_goes_wrong_is_one_too_many(
    other: dict[str, Any], as_planned: bool, in_a_world: bool
) -> None:
    line = line_of([row()] * 29 + [other])
    assert (is_well(line, as_planned=True), is_well(line, as_planned=False)) == (as_planned, in_a_world)


def test_a_climb_that_broke_off_counts_and_has_no_speed() -> None:
    line = line_of([row(), {"verdict": "failed", "reason": "too far", "climb": {"ok": False, "error": "too far"}}])
    assert (line["climbs"], line["at_goal"], line["median_m_min"]) == (2, 1, 0.6)
