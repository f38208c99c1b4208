"""The pairs of start and goal that the benches share."""

from __future__ import annotations

import pytest
from crux_contracts.scenario import parse_scenario
from crux_simulation.benchmarks.pairs import TASKS, pair, pairs


@pytest.mark.parametrize("task", TASKS)
def test_the_same_seed_draws_the_same_pair(task: str) -> None:
    first = pairs(task, 3)
    assert first == pairs(task, 3)
    assert len({text for _, text in first}) == 3
    assert pair(task, 2) == first[1][1]


def test_pairs_are_scenarios_of_their_contact_model() -> None:
    for seed in range(1, 6):
        climb, walk = (parse_scenario(pair(task, seed), "pair.yaml") for task in TASKS)
        assert climb.contact.model == "patch"
        assert len(climb.goal.grasps) == 4
        assert walk.contact.model == "point"
        assert not walk.cuboids


def test_an_unknown_task_is_named() -> None:
    with pytest.raises(ValueError, match="swimming"):
        pair("swimming", 1)
