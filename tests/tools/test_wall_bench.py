"""`crux bench walls`: its walls are scenarios, and its table is what planner and judge said."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_simulation.benchmarks.many_walls import WALLS, WallJob, wall_job
from crux_simulation.campaign import engine
from crux_tools.cli import main
from crux_tools.report import results

CLIMB = {"ok": True, "slips": 0, "largest_slip_m": 0.0004, "m_min": 0.185}
PLANNED = {"ok": True, "cost": 9.62, "gap": 0.19, "computed_s": 4.2}
ROWS: list[dict[str, Any]] = [
    {"walls": "good", "plan": PLANNED, "climb": CLIMB, "cpu_s": 9.0, "verdict": results.CLIMBED, "reason": ""},
    {"walls": "steep", "plan": {"ok": False}, "cpu_s": 60.0, "verdict": results.UNDECIDED, "reason": "out of reach"},
    {"walls": "slick", "plan": PLANNED, "climb": CLIMB | {"ok": False, "slips": 2}, "cpu_s": 9.0,
     "verdict": results.FAILED, "reason": "2 slips"},
]  # fmt: skip


@pytest.mark.parametrize("path", sorted(WALLS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_wall_is_a_scenario_of_its_file_s_name(path: Path) -> None:
    assert load_scenario(path).name == path.stem


def bench(monkeypatch: pytest.MonkeyPatch, folder: Path, rows: list[dict[str, Any]], *words: str) -> int:
    """On walls of which these rows come."""
    monkeypatch.setattr(engine, "run_anew", lambda jobs, *_: rows[: len(jobs)])
    files = [str(shutil.copy(WALLS / "edge-30.yaml", folder / f"{row['walls']}.yaml")) for row in rows]
    return main(["bench", "walls", *files, "--output", str(folder / "out"), *words])


def test_the_table_says_what_became_of_each_wall(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench(monkeypatch, tmp_path, ROWS) == 1
    told = [" ".join(line.split()) for line in capsys.readouterr().err.splitlines()]
    assert told[:4] == [
        "wall verdict J gap % CPU s climbed slips slip mm m/min why not",
        "good solved 9.62 19 4.2 yes 0 0.40 0.185",
        "steep undecided - - 60.0 - - - - out of reach",
        "slick WRONG 9.62 19 4.2 NO 2 0.40 0.185 2 slips",
    ]
    assert "1 of 3 decided within 60 s of computing each: 1 climbed" in told[4]


def test_it_succeeds_where_all_is_decided_and_climbed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench(monkeypatch, tmp_path, ROWS[:1], "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["ok"], said["decided"], said["walls"][0]["J"]) == (True, 1, 9.62)


def test_a_file_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "walls", str(tmp_path / "no.yaml"), "--output", str(tmp_path / "out")]) == 2
    assert f"{tmp_path}/no.yaml: expected a scenario file" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_wall_is_planned_for_another_objective_where_one_is_given() -> None:
    wall = parse_scenario(wall_job(WALLS / "edge-30.yaml", 9.0, "time").wall.scenario())
    assert (wall.name, wall.planner.objective) == ("edge-30", "time")


def test_speed_is_that_of_the_body_from_start_to_goal() -> None:
    """0.3 m in 1000 cycles of 2 ms of climbing, with a second before it."""
    cycle, away_m = np.arange(0, 1501, 5), np.linspace(0.0, 0.45, 301)
    truth = SimpleNamespace(
        cycle=cycle, climbing=(cycle >= 500).astype(int), body_position_m=np.outer(away_m, [1.0, 0.0, 0.0])
    )
    result: Any = SimpleNamespace(truth=truth, model=SimpleNamespace(robot=SimpleNamespace(dt_s=0.002)))
    assert WallJob("wall", wall_job(WALLS / "edge-30.yaml", 9.0).wall)._measured(None, result) == {
        "m_min": pytest.approx(0.3 / (2.0 / 60.0))
    }


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["corner-90", "ridge-60"])
def test_it_plans_and_climbs(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "walls", str(WALLS / f"{name}.yaml"), "--output", str(tmp_path), "--json"]) == 0
    (line,) = json.loads(capsys.readouterr().out)["walls"]
    assert (line["verdict"], line["climbed"], line["slips"]) == ("solved", True, 0)
    assert line["m_min"] > 0.1
