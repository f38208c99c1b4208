"""Plans for tests: shared by those that look at the same, or without the proof of their cost."""

from __future__ import annotations

import fcntl
import hashlib
import pickle
from pathlib import Path
from typing import Any, cast

import crux_planner
import pytest
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import Scenario, load_scenario
from crux_planner.pipeline.message import PlanResult
from crux_planner.solvers.worker import Worker

SCENES = Path(__file__).resolve().parents[2] / "msgs" / "scenarios"


class SharedPlans:
    """Plans as `unproven` does, or with the bound of the cost; what came of the same scenario and robot is kept in a
    folder that all processes of the session share. Not for tests that change the planner, nor for those of what it says
    on the way.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        self._folder = folder

    def __call__(self, scenario: Scenario, robot: Robot, proven: bool = False) -> PlanResult:
        """A copy of the plan of its own for every caller."""
        path = self._folder / hashlib.sha256(f"{proven} {robot.hash} {scenario.yaml_text}".encode()).hexdigest()
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                plan = crux_planner.plan if proven else unproven
                path.write_bytes(pickle.dumps(plan(scenario, robot)))
        return cast(PlanResult, pickle.loads(path.read_bytes()))

    def write(self, scene: str, path: Path) -> None:
        """The plan of a shipped scene and its robot, as a file."""
        scenario = load_scenario(SCENES / f"{scene}.yaml")
        write_plan(path, self(scenario, load_robot(scenario.robot)).plan)


class _NotStarted(Worker):
    """A worker that is lost before it says anything."""

    def start(self) -> None:
        self.lost = True


def unproven(scenario: Scenario, robot: Robot, **how: Any) -> PlanResult:
    """`crux_planner.plan` without the bound of the cost, which takes more than half of the computing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("crux_planner.pipeline.at_once.Worker", _NotStarted)
        return crux_planner.plan(scenario, robot, **how)
