"""Planning again from the stances of a running plan."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import pytest
from crux_contracts.robot import load_robot
from crux_planner.errors import InfeasibleError
from crux_planner.planning import plan
from crux_planner.replanning import Planner, stances
from walls import scenario, two_rows


@lru_cache
def route() -> tuple[Planner, Any]:
    wall, robot = scenario(two_rows()), load_robot("scaler")
    return Planner(wall, robot), plan(wall, robot).plan


def test_a_plan_made_again_starts_where_the_running_one_holds_on_and_passes_the_check() -> None:
    planner, running = route()
    found = stances(running)
    assert len(found) == 5  # the start and one after each move
    for k in found[1:]:
        result = planner.replan(running, k * running.dt_s)
        assert result.ok
        assert result.check.ok
        first, knot = result.plan.knots[0], running.knots[k]
        assert list(first.body_position_w_m) == pytest.approx(list(knot.body_position_w_m), abs=1e-9)
        assert [limb.hold for limb in first.limbs] == [limb.hold for limb in knot.limbs]
        assert [limb.hold for limb in result.plan.knots[-1].limbs] == [limb.hold for limb in running.knots[-1].limbs]


def test_in_mid_swing_the_next_stance_is_taken() -> None:
    planner, running = route()
    k = stances(running)[1]
    result = planner.replan(running, (k - 0.5) * running.dt_s)
    assert list(result.plan.knots[0].body_position_w_m) == pytest.approx(list(running.knots[k].body_position_w_m))


def test_after_the_end_there_is_nothing_to_plan() -> None:
    planner, running = route()
    with pytest.raises(InfeasibleError, match="ends at"):
        planner.replan(running, 1e4)
