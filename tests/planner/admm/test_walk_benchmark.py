"""P1 of a walk as one NLP with relaxed binaries."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner import plan
from crux_planner.admm.walk_benchmark import slots_of
from crux_planner.errors import InfeasibleError
from crux_planner.solvers import clock
from crux_planner.solvers.relaxation import RELAXATIONS, Relaxed, Watch

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"
ROBOT = load_robot("scaler")
SLOPE = (SCENES / "walk-slope.yaml").read_text()


@pytest.mark.sweep
def test_a_short_wait_is_planned_and_passes_the_check() -> None:
    waiting = SLOPE.replace("[0.1, 0.0, 0.185]", "[0.0, 0.0, 0.185]").replace("steps: 40", "steps: 8")
    lines: list[str] = []
    result = plan(parse_scenario(waiting), ROBOT, method="benchmark", log=lines.append)
    shown: dict[str, Any] = result.to_json()
    assert result.check.ok
    assert result.plan.method == "benchmark"
    assert shown["method_report"]["converged"]
    assert tuple(shown["method_report"]["relaxations"]) == RELAXATIONS
    assert sum(shown["method_report"]["relaxations"].values()) == shown["iterations"] > 0
    assert len(lines) == len(RELAXATIONS)
    assert shown["history"] == []


def test_it_says_how_far_it_came_within_its_time_limit() -> None:
    with pytest.raises(InfeasibleError, match=r"relaxation [0-9.]+, \d of 5, after \d+ iterations; it came to") as said:
        plan(parse_scenario(SLOPE), ROBOT, method="benchmark", time_limit_s=2.0)
    off = re.search(r"rows off by up to ([0-9.e+-]+), \d+ % of the contacts", str(said.value))
    assert off is not None
    assert np.isfinite(float(off.group(1)))


def test_no_iteration_begins_that_would_end_after_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([10.0, 10.4, 10.9, 11.4, 11.6])  # the longest takes 0.5 s
    monkeypatch.setattr(clock, "now", lambda: next(times))
    watch = Watch(1, 1, 1, 12.0)
    assert [watch.eval(None) for _ in range(4)] == [[0], [0], [0], [1]]
    assert watch.late


def test_binaries_are_pressed_to_the_better_end() -> None:
    """min (a - 0.4)^2 + (b - 0.8)^2 with a, b binary and b v = 0, v free to pay 0.1 for: a = 0, b = 1, v = 0."""
    x, relaxed_by = ca.MX.sym("x", 3), ca.MX.sym("relaxed_by")
    cost = (x[0] - 0.4) ** 2 + (x[1] - 0.8) ** 2 + (x[2] - 0.1) ** 2
    rows = ca.vertcat(relaxed_by - x[:2] * (1 - x[:2]), relaxed_by - x[1] * x[2])
    relaxed = Relaxed(
        {"x": x, "p": relaxed_by, "f": cost, "g": rows},
        (np.zeros(3), np.ones(3)),
        (np.zeros(3), np.full(3, np.inf)),
        lambda values: values[:2],
    )
    values, iterations = relaxed.solve(np.array([0.5, 0.5, 0.5]), clock.now() + 10.0)
    assert len(iterations) == len(RELAXATIONS)
    assert values == pytest.approx([0.0, 1.0, 0.0], abs=2e-3)
    with pytest.raises(InfeasibleError, match="runs out of time at relaxation"):
        relaxed.solve(np.array([0.5, 0.5, 0.5]), clock.now() - 1.0)


def test_short_whiles_in_the_air_become_steps() -> None:
    stance = np.ones((21, 4), dtype=bool)
    stance[6:11, 0] = False
    stance[8, 1] = False
    stance[2:4, 2] = False
    stance[[5, 7], 3] = False
    slots = slots_of(stance)
    assert slots.of_limb == (((6, 11),), ((7, 10),), ((2, 5),), ((4, 9),))
