"""Two limbs at a time: which moves are made together, and a slab that is climbed so in the least time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.plan_series import plan_series
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, load_scenario
from crux_planner.model.schedule import Move, Stance, stance_after
from crux_planner.pipeline import two_at_once
from crux_planner.pipeline.restart import edited, with_objective
from crux_planner.pipeline.two_at_once import paired
from crux_planner.search.event_cost import Timed
from shared_plans import unproven

SLAB = Path(__file__).parents[3] / "msgs" / "scenarios" / "climb-slab.yaml"
NOWHERE = np.zeros(3)


def timed(*steps: tuple[int, int]) -> Timed:
    """Limbs that go to contacts one after the other, from stance 0, 1, 2, 3; move i takes 2 + i knots."""
    stance: Stance = (0, 1, 2, 3)
    moves = []
    for limb, end in steps:
        after = stance_after(stance, (limb,), (end,))
        moves.append(Move(stance, after, (limb,), NOWHERE, NOWHERE))
        stance = after
    return Timed(moves, np.arange(1.0, len(steps) + 2), np.arange(2.0, len(steps) + 2))


def test_moves_made_together_take_as_long_as_the_slower_and_the_others_follow_as_they_were() -> None:
    both = paired(timed((1, 5), (0, 4), (2, 6), (3, 7)), 1, 3)
    assert both is not None
    assert [(move.limbs, move.before, move.after) for move in both.moves] == [
        ((1,), (0, 1, 2, 3), (0, 5, 2, 3)),
        ((0, 3), (0, 5, 2, 3), (4, 5, 2, 7)),
        ((2,), (4, 5, 2, 7), (4, 5, 6, 7)),
    ]
    assert both.swings.tolist() == [2, 5, 4]
    assert both.stances.tolist() == [1, 2, 3, 5]


def test_a_limb_that_moves_in_between_or_three_limbs_are_not_made_one() -> None:
    sequence = timed((1, 5), (0, 4), (1, 8), (3, 7))
    assert paired(sequence, 1, 2) is not None
    assert paired(sequence, 0, 2) is None
    assert paired(sequence, 0, 3) is not None
    pair = paired(sequence, 0, 1)
    assert pair is not None
    assert paired(pair, 0, 2) is None


def slab(slope_deg: float, objective: str = "time") -> Scenario:
    scenario = edited(load_scenario(SLAB), lambda content: content["wall"].update(slope_deg=slope_deg))
    return with_objective(scenario, objective)


def in_the_air(scenario: Scenario, robot: Robot) -> tuple[int, float]:
    """The most limbs at once, and how long the plan takes [s]."""
    series = plan_series(unproven(scenario, robot).plan)
    return int((~series.stance).sum(axis=1).max()), float(series.time_s[-1])


def test_a_slab_is_climbed_with_two_limbs_at_once_where_time_counts(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    together, took_s = in_the_air(slab(20), robot)
    assert together == 2
    monkeypatch.setattr(two_at_once, "AHEAD", 0)
    one_by_one, longer_s = in_the_air(slab(20), robot)
    assert one_by_one == 1
    assert took_s < 0.85 * longer_s


@pytest.mark.parametrize(("slope_deg", "objective"), [(90, "time"), (20, "balanced")])
def test_one_limb_at_a_time_on_steep_walls_and_where_time_does_not_count_alone(
    robot: Robot, slope_deg: float, objective: str
) -> None:
    assert in_the_air(slab(slope_deg, objective), robot)[0] == 1


def test_no_pair_is_tried_with_grips_that_do_not_hold_the_body() -> None:
    sequence, asked = timed((0, 4), (3, 7)), list[Timed]()
    swings = type("Swings", (), {"free": lambda *_: True})()
    for stands in (False, True):
        pairs = two_at_once.TwoAtOnce(swings, lambda _move, stands=stands: stands, asked.append)  # type: ignore[misc]
        assert pairs.plan(sequence) is None
        assert len(asked) == stands
    assert asked[0].moves[0].limbs == (0, 3)
