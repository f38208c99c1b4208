"""Whole plans by the distributed methods."""

from __future__ import annotations

import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.admm.methods import METHODS, Task
from crux_planner.errors import InfeasibleError
from crux_planner.pipeline.entry import plan
from crux_planner.search.stances import Oracles
from scenes import scene, wall


@pytest.mark.parametrize("method", ["two_block", "multi_block"])
def test_a_climb_converges_and_passes_the_check(method: str) -> None:
    lines: list[str] = []
    result = plan(parse_scenario(wall(30)), load_robot("scaler"), method=method, log=lines.append)
    shown = result.to_json()
    assert result.ok
    assert result.check.ok
    assert result.plan.method == method
    assert shown["residuals"]["position_m"] <= 0.03
    assert shown["residuals"]["force_N"] <= 0.5
    assert shown["iterations"] == len(shown["history"]) == len(lines)
    assert all(f"iteration {i}:" in line for i, line in enumerate(lines, 1))
    assert shown["method_report"]["converged"]
    assert shown["method_report"]["gait"] == result.gait
    assert shown["cost"] <= shown["method_report"]["cost"] + 0.05


def test_iterations_are_limited() -> None:
    small = scene(30)
    task = Task(**vars(Oracles.of(small.problem)), deadline=small.later, iterations=2)
    decided = METHODS["multi_block"](task)
    assert decided.iterations == 2
    assert not decided.converged


def test_the_benchmark_says_when_it_ran_out_of_time() -> None:
    with pytest.raises(InfeasibleError, match=r"runs out of time at relaxation 0.25, 1 of 5, .* rows off by up to"):
        plan(parse_scenario(wall(30)), load_robot("scaler"), method="benchmark", time_limit_s=2.0)
