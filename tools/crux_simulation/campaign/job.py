"""One job of a campaign: plan, check, climb, judge, all in this process."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from crux_contracts.plan_file import read_plan, write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, ScenarioError, parse_scenario
from crux_contracts.yaml_document import DocumentError
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.report.results import (
    CLIMBED,
    FAILED,
    INFEASIBLE,
    LOG_FILE,
    PLANNED,
    REFUSED,
    SUCCESSES,
    UNDECIDED,
    WRONG,
)

from crux_simulation.campaign.walls import Wall

NOMINAL = "nominal"
SCENARIO_FILE, WORLD_FILE, PLAN_FILE = "scenario.yaml", "world.yaml", "plan.mcap"
AGAIN_FILE, RERUN_FILE = "again.mcap", "rerun.sh"


@dataclass(frozen=True)
class WorldFile:
    """The world that a plan is climbed in: the text of its file, drawn by the job's seed; none: as the plan says."""

    name: str = NOMINAL
    text: str = ""

    def draw(self, seed: int, plan: Any) -> Any:
        """The world for ClimbOptions; raises WorldError."""
        from crux_simulation.sim.world_file import parse_world

        return parse_world(self.text.encode(), self.name).draw(seed, plan) if self.text else None


@dataclass
class Outcome:
    """What a job leaves: one row of the table, nested, and its files by name."""

    row: dict[str, Any]
    files: dict[str, bytes] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether nobody needs its files."""
        return self.row["verdict"] in SUCCESSES


@dataclass(frozen=True)
class ClimbJob:
    """A wall to be planned by a method and climbed in a world; `seed`: of the sensors and of what the world draws."""

    walls: str
    """the name of the spec's entry; no part of the key"""
    wall: Wall
    seed: int = 0
    world: WorldFile = WorldFile()
    method: str | None = None
    """the scenario's where None"""
    time_limit_s: float | None = None
    """of the planner's computing; the scenario's where None"""
    climbs: bool = True
    """False: planned and checked alone"""

    @property
    def key(self) -> str:
        """The same for the same job everywhere: a hash of what it depends on, but for the code."""
        parts = {name: value for name, value in asdict(self).items() if name != "walls"}
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]

    def run(self) -> Outcome:
        """Does it; what is wrong with wall, plan or climb is a verdict, not an error."""
        text = self.wall.scenario()
        outcome = Outcome({"key": self.key, **self.labels(), "wall_hash": _short_hash(text)})
        outcome.files = {SCENARIO_FILE: text.encode(), RERUN_FILE: self._commands().encode()}
        with TemporaryDirectory(prefix="crux-job-") as folder:
            verdict, reason = self._carry_out(text, Path(folder), outcome.row)
            outcome.files |= {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}
        outcome.row |= {"verdict": verdict, "reason": reason}
        return outcome

    def labels(self) -> dict[str, Any]:
        """The columns that say which job it is."""
        return {
            "walls": self.walls, "wall_seed": self.wall.seed, "world": self.world.name, "seed": self.seed,
            "method": self.method or "",
        }  # fmt: skip

    def _carry_out(self, text: str, folder: Path, row: dict[str, Any]) -> tuple[str, str]:
        """Verdict and reason; what planner, checker and judge say goes into `row`, their files into `folder`."""
        from crux_planner import InfeasibleError
        from crux_planner.checker import check_plan

        try:
            scenario = parse_scenario(text, SCENARIO_FILE)
            row["wall"], row["method"] = scenario.name, self.method or scenario.planner.method
            row["plan"] = self._plan(scenario, folder / PLAN_FILE)
        except ScenarioError as error:
            row["plan"] = {"ok": False, "error": str(error)}
            return REFUSED, str(error)
        except InfeasibleError as error:
            row["plan"] = {"ok": False, "error": str(error), **error.to_json()}
            return INFEASIBLE if error.proven else UNDECIDED, f"{error.verdict} ({error.constraint}): {error}"
        plan, robot = read_plan(folder / PLAN_FILE), load_robot(scenario.robot)
        report = check_plan(plan, robot)
        row["check"] = {"ok": report.ok, "violations": len(report.violations)}
        if not report.ok:
            first = report.violations[0]
            return WRONG, f"the plan fails the check: {first.constraint}: {first.detail}"
        if not self.climbs:
            return PLANNED, ""
        row["climb"] = self._climb(plan, robot, folder)
        return CLIMBED if row["climb"]["ok"] else FAILED, row["climb"].get("reason") or row["climb"].get("error", "")

    def _plan(self, scenario: Scenario, path: Path) -> dict[str, Any]:
        """Of what `crux plan --json` prints, without what would swell the table; the plan goes to `path`.

        Raises ScenarioError, InfeasibleError.
        """
        from crux_planner import plan

        method = self.method or scenario.planner.method
        result = plan(scenario, load_robot(scenario.robot), method=method, time_limit_s=self.time_limit_s)
        write_plan(path, result.plan)
        said = {**result.to_json(), "plan_id": result.plan.plan_id}
        return {name: value for name, value in said.items() if name not in ("check", "history", "method_report")}

    def climb_command(self) -> str:
        """What climbs so, beside the job's files."""
        world = f" --world {WORLD_FILE}" if self.world.text else ""
        return f"crux climb {PLAN_FILE} -o {AGAIN_FILE} --seed {self.seed}{world}"

    def _climb(self, plan: Any, robot: Any, folder: Path) -> dict[str, Any]:
        """What `crux climb --json` prints, but for the log's place; log and drawn world go into `folder`."""
        from crux_simulation.sim.climb import climb

        try:
            world = self.world.draw(self.seed, plan)
            if world is not None:
                (folder / WORLD_FILE).write_text(world.as_yaml(), encoding="utf-8")
            result = climb(plan, robot, folder / LOG_FILE, self._options(world))
        except (UsageError, WorkFailed, DocumentError) as error:
            return {"ok": False, "error": str(error)}
        told = {name: value for name, value in result.as_json().items() if name != "log"}
        return told | self._measured(plan, result)

    def _measured(self, _plan: Any, _result: Any) -> dict[str, Any]:
        """What else is to be known of a climb, from its ClimbResult."""
        return {}

    def _options(self, world: Any) -> Any:
        """ClimbOptions of the climb."""
        from crux_simulation.sim.climb import ClimbOptions

        return ClimbOptions(seed=self.seed, world=world)

    def _commands(self) -> str:
        """A shell script that does the same by commands of crux, beside the job's files."""
        method = f" --method {self.method}" if self.method else ""
        limit = f" --time-limit {self.time_limit_s:g}" if self.time_limit_s else ""
        lines = ["#!/bin/sh -e", 'cd "$(dirname "$0")"', f"crux plan {SCENARIO_FILE} -o {PLAN_FILE}{method}{limit}"]
        lines.append(f"crux check {PLAN_FILE}")
        if self.climbs:
            lines.append(f"{self.climb_command()} --report report.html")
        return "\n".join(lines) + "\n"


def _short_hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
