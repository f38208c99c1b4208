"""`crux bench loop`: what is counted of climbs without and with planning again on the way, and what is no worse."""

from __future__ import annotations

from typing import Any

import pytest
from crux_simulation.benchmarks.replanned_climbs import AS_PLANNED, WORLD, LoopJob, is_no_worse, loop_line
from crux_simulation.campaign.job import WorldFile
from crux_simulation.campaign.walls import Wall
from crux_simulation.sim.world_file import read_world
from hand_plan import standing_plan


def row(reached: bool, slips: int = 0, made: tuple[tuple[float, bool], ...] = ()) -> dict[str, Any]:
    each = [{"seconds": seconds, "computed_s": seconds / 2, "kept": kept} for seconds, kept in made]
    climb = {
        "ok": reached and not slips, "reached_goal": reached, "slips": slips, "fell": False, "lost_grips": [],
        "margin": 0.4, "time_s": 50.0, "tracking": {"force_N": 0.5}, "replans": {"each": each},
    }  # fmt: skip
    return {"walls": AS_PLANNED, "reason": "", "plan": {"cost": 12.0}, "climb": climb}


def test_a_line_has_the_replans_of_all_climbs() -> None:
    line = loop_line([row(True, made=((0.1, True), (0.4, False))), row(False, slips=2, made=((0.2, True),))])
    assert (line["reached_goal"], line["at_goal"], line["slips"]) == (1, 1, 2)
    assert (line["replans"], line["kept"]) == (3, 2)
    assert (line["replan_median_s"], line["replan_worst_s"]) == (0.2, 0.4)
    assert line["replan_median_computed_s"] == pytest.approx(0.1)
    assert loop_line([row(True)])["replan_median_s"] is None


@pytest.mark.parametrize(
    ("changed", "ok"),
    [({}, True), ({"reached_goal": 9}, False), ({"slips": 1}, False), ({"fell": 1}, False), ({"lost_grips": 1}, False),
     ({"replan_median_s": 0.21}, False)],
)  # fmt: skip
def test_no_worse_is_at_the_goal_as_often_without_more_that_goes_wrong_and_in_time(
    changed: dict[str, Any], ok: bool
) -> None:
    line = {"reached_goal": 10, "slips": 0, "fell": 0, "lost_grips": 0, "replan_median_s": 0.2}
    assert is_no_worse(line, line | changed) is ok


def test_the_world_draws_holds_off_and_turned_as_it_says() -> None:
    world = read_world(WORLD).draw(1, standing_plan())
    text = world.as_yaml()
    assert "offset_m" in text
    assert "yaw_deg" in text
    assert "friction_factor" in text


def test_both_ways_are_two_jobs_that_a_shell_can_repeat() -> None:
    jobs = [LoopJob("", Wall(text="a"), 1, WorldFile("w", "version: 1"), replans=on) for on in (False, True)]
    assert jobs[0].key != jobs[1].key
    assert [job.climb_command().endswith("--replan") for job in jobs] == [False, True]
