"""Time limits count computing: a busy machine changes no answer, and time that ran out is no infeasibility."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from pathlib import Path

import crux_planner
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import load_scenario
from crux_planner.errors import TIME_LIMIT, InfeasibleError
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Worker
from shared_plans import SharedPlans
from walls import one_move, scenario, two_rows

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"
BUSY_S = 0.3


@pytest.fixture
def slow_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whenever the wall clock is asked, 20 s more have gone by."""
    asked = itertools.count(time.monotonic(), 20.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(asked))


@pytest.mark.usefixtures("slow_machine")
def test_a_busy_machine_finds_the_same_climb(robot: Robot, planned: SharedPlans) -> None:
    slow = crux_planner.plan(scenario(one_move()), robot, time_limit_s=30.0)
    usual = planned(scenario(one_move()), robot, proven=True)
    assert (slow.cost, slow.gait, slow.gap) == (usual.cost, usual.gait, usual.gap)


@pytest.mark.usefixtures("slow_machine")
def test_a_busy_machine_finds_a_walk(robot: Robot) -> None:
    assert crux_planner.plan(load_scenario(SCENES / "walk-flat.yaml"), robot, time_limit_s=30.0).check.ok


def busy() -> None:
    while time.process_time() < BUSY_S:
        pass


def test_what_workers_compute_counts_while_they_live_and_afterwards() -> None:
    worker = Worker()
    before, own = clock.now(), time.process_time()
    worker.begin(busy)
    worker.receive()
    assert clock.computed_s(worker.pid) >= BUSY_S
    assert clock.now() - before >= BUSY_S + time.process_time() - own - 0.05
    worker.stop()
    assert clock.computed_s(worker.pid) == 0.0
    assert clock.now() - before >= BUSY_S + time.process_time() - own - 0.05


def test_what_other_children_computed_does_not_count() -> None:
    before, own = clock.now(), time.process_time()
    loop = f"import time\nwhile time.process_time() < {BUSY_S}: pass"
    subprocess.run([sys.executable, "-c", loop], check=True)
    assert clock.now() - before < time.process_time() - own + 0.05


def test_time_that_ran_out_is_no_infeasibility() -> None:
    late = InfeasibleError(TIME_LIMIT, "no sequence found")
    assert (late.verdict, late.to_json()["undecided"]) == ("undecided", True)
    reason = InfeasibleError("reach", "no hold within reach").out_of_time()
    assert (reason.verdict, reason.constraint) == ("undecided", TIME_LIMIT)  # reach was not tried
    assert "time ran out before all was tried" in str(reason)
    assert "no hold within reach" in str(reason)
    proven = InfeasibleError("reach", "no hold", proven=True).out_of_time()
    assert (proven.verdict, proven.undecided) == ("proven infeasible for all that the limbs reach", False)
    assert InfeasibleError("horizon", "too short").verdict == "infeasible"


def test_a_search_for_headings_that_its_time_ends_leaves_it_undecided(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock of work: every look at it is so much of the limit."""
    wall = two_rows()
    wall["goal"]["body"]["position_m"] = [0.15, 0.0, 0.185]
    looks = itertools.count()
    monkeypatch.setattr(clock, "now", lambda: 0.5 * next(looks))
    with pytest.raises(InfeasibleError) as error:
        crux_planner.plan(scenario(wall), robot, time_limit_s=3.0)
    assert error.value.undecided
    assert not error.value.proven
