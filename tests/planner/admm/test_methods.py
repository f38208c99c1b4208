"""Whole plans by the distributed methods."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_planner.admm.limbs import ClimbLimbs, LimbMips
from crux_planner.admm.methods import METHODS, Task
from crux_planner.errors import InfeasibleError
from crux_planner.method_report import climb_report
from crux_planner.physics.limit_surface import finger_forces
from crux_planner.pipeline.entry import plan
from crux_planner.pipeline.session import LONGER_S
from crux_planner.solvers.worker import Team
from crux_planner.trajectory.consensus import Scales
from scenes import scene, wall

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["climb-four-holds", "walk-flat"])
def test_multi_block_ends_within_its_usual_time(name: str) -> None:
    result = plan(load_scenario(SCENES / f"{name}.yaml"), load_robot("scaler"), method="multi_block")
    assert result.ok
    assert result.computed_s < LONGER_S["multi_block"]


@pytest.mark.parametrize("method", ["two_block", pytest.param("multi_block", marks=pytest.mark.sweep)])
def test_a_climb_converges_and_passes_the_check(method: str) -> None:
    lines: list[str] = []
    result = plan(parse_scenario(wall(22)), load_robot("scaler"), method=method, log=lines.append)
    shown: dict[str, Any] = result.to_json()
    assert result.ok
    assert result.check.ok
    assert result.plan.method == method
    assert shown["residuals"]["position_m"] <= 0.03
    assert shown["residuals"]["force_N"] <= 0.5
    iterations = [line for line in lines if line.startswith("iteration")]
    assert shown["iterations"] == len(shown["history"]) == len(iterations)
    assert all(f"iteration {i}:" in line for i, line in enumerate(iterations, 1))
    assert shown["method_report"]["converged"]
    assert shown["method_report"]["gait"] == result.gait
    assert shown["cost"] <= shown["method_report"]["cost"] + 0.05


@pytest.mark.sweep
@pytest.mark.parametrize(("iterations", "fall"), [(4, 6), (6, 8)])
def test_the_residuals_of_two_block_fall_from_a_cold_start(iterations: int, fall: int) -> None:
    wall = load_scenario(SCENES / "climb-four-holds.yaml")
    report = climb_report(wall, "two_block", iterations=iterations, to_the_end=True)
    forces = [each["force_rms_N"] for each in report.decided.history]
    positions = [each["position_rms_m"] for each in report.decided.history]
    assert len(forces) == iterations
    assert forces[0] > 2.0  # the NLP has moments to correct: the MIP knows of none
    assert all(later < before for before, later in pairwise(forces))
    assert forces[-1] < forces[0] / fall
    assert positions[-1] < positions[0] / 4


def test_the_methods_begin_without_the_search_of_auto() -> None:
    """Nothing of it is even imported."""
    searches = "[name for name in sys.modules if name.startswith('crux_planner.search')]"
    code = f"import sys, crux_planner.admm.methods; print({searches})"
    shown = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert shown.strip() == "[]"


def test_limbs_alone_meet_the_forces_of_their_copy_on_the_limit_surface() -> None:
    """Each limb's block and QP against the definition: nearest forces within (2), (3), none in the air."""
    small = scene(30)
    problem, scales = small.problem, Scales(force=1.0, moment=1.0)
    limbs = ClimbLimbs(small.windows, Team((), LimbMips, small.windows, scales), scales)
    target = limbs.standing()
    grip = [problem.contacts[c] for c in problem.start_contacts]
    wanted = np.array([2.0, -1.0, 0.0, 9.0, 7.0])
    for limb, contact in enumerate(grip):
        place = slice(2 * limb, 2 * limb + 2)
        target.forces[:, place], target.moments[:, place] = finger_forces(wanted, contact.axis, contact.tangent)
    plan = limbs.minimise(1e4, target)
    assert sorted(set(plan.knots.order)) != []
    for k, knot in enumerate(plan.knots.wrenches):
        assert set(knot) == {limb for limb, c in enumerate(plan.knots.schedule.contacts[k]) if c is not None}
    for limb in range(4):
        assert plan.knots.wrenches[0][limb] == pytest.approx(wanted, abs=0.01)


def test_multi_block_says_that_it_did_not_converge() -> None:
    """At first limbs are away together: nothing but the copy is in their way."""
    small = scene(30)
    lines: list[str] = []
    task = Task(windows=small.windows, deadline=small.later, iterations=2, report=lines.append)
    decided = METHODS["multi_block"](task)
    assert decided.iterations == 2
    assert not decided.converged
    assert any("+" in together for together in decided.gaits[0])
    assert decided.residuals[0].out_of_turn > 0
    assert lines[-1] == "not converged after 2 iterations"


def test_the_benchmark_says_when_it_ran_out_of_time() -> None:
    with pytest.raises(InfeasibleError, match=r"runs out of time at relaxation 0.25, 1 of 5, .* rows off by up to"):
        plan(parse_scenario(wall(30)), load_robot("scaler"), method="benchmark", time_limit_s=2.0)
