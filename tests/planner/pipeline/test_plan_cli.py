"""`crux plan` as a command: exit status, what goes where, and nothing written unless the plan is good."""

from __future__ import annotations

import argparse
import json
import os
import re
import time
from pathlib import Path
from typing import Any

import pytest
from crux_contracts.plan_file import read_plan
from crux_planner.cli import add_plan_parser, run_plan
from walls import hold, one_move, text, two_rows


def crux_plan(*words: str) -> int:
    parser = argparse.ArgumentParser()
    add_plan_parser(parser.add_subparsers())
    return run_plan(parser.parse_args(["plan", *words]))


def write(folder: Path, content: dict[str, Any]) -> tuple[str, Path]:
    (folder / "wall.yaml").write_text(text(content))
    return str(folder / "wall.yaml"), folder / "plan.mcap"


def test_a_plan_is_written_and_described_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall, output = write(tmp_path, one_move())[0], tmp_path / "new" / "folder" / "plan.mcap"
    assert crux_plan(wall, "-o", str(output), "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["ok"] is True
    assert said["method"] == "auto"
    assert said["check"]["ok"] is True
    assert {"seconds", "cost", "gap", "iterations", "gait"} <= said.keys()
    assert 0.0 < said["computed_s"] < said["seconds"] * len(os.sched_getaffinity(0)) + 1.0
    assert said["scope"].startswith("for all that the limbs reach")
    assert {"position_m", "force_N"} == said["residuals"].keys()
    assert read_plan(output).plan_id == said["plan_id"]
    assert [path.name for path in output.parent.iterdir()] == ["plan.mcap"]


def test_both_times_and_what_is_proven_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The time by the clock, and that which the limit counts: what the process and its workers computed, here or more;
    and the lower bound of the cost, for the reach that it plans with."""
    wall, output = write(tmp_path, one_move())
    since = time.process_time()
    assert crux_plan(wall, "-o", str(output)) == 0
    own_s = time.process_time() - since
    said = capsys.readouterr().out
    found = re.search(r"in [\d.]+ s by the clock .*\ncomputed for ([\d.]+) s, which --time-limit", said)
    assert found is not None
    assert float(found[1]) > 0.3 * own_s
    (proven,) = [line for line in said.splitlines() if line.startswith("proven")]
    assert proven.startswith("proven for all that the limbs reach, ")


def test_a_wrong_scenario_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall, output = write(tmp_path, {**two_rows(), "wall": {"slope": 45}})
    output.write_bytes(b"an older plan")
    assert crux_plan(wall, "-o", str(output), "--json") == 2
    out, errors = capsys.readouterr()
    assert "slope" in errors
    assert json.loads(out)["ok"] is False
    assert output.read_bytes() == b"an older plan"


def test_a_certificate_that_cannot_be_had_is_told_by_the_exit_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wall = one_move()
    wall["holds"] += [hold(f"more-{x}-{y}", 0.45 + 0.15 * x, -0.36 + 0.18 * y) for x in range(3) for y in range(5)]
    path, output = write(tmp_path, wall)
    assert crux_plan(path, "-o", str(output), "--certificate", str(tmp_path / "proof.json"), "--json") == 3
    out, errors = capsys.readouterr()
    assert "no certificate of a bound" in errors
    said = json.loads(out)
    assert (said["ok"], said["certified_bound"]) == (True, None)
    assert read_plan(output).plan_id == said["plan_id"]
    assert not (tmp_path / "proof.json").exists()


def far_goal() -> dict[str, Any]:
    return {**two_rows(), "goal": {"body": {"position_m": [1.0, 0.0, 0.185]}}}


@pytest.mark.parametrize(
    ("wall", "limit", "verdict", "said"),
    [
        (two_rows(), "0.001", "undecided", {"proven": False, "undecided": True, "scope": None}),
        (
            far_goal(),
            "60",
            "proven infeasible for all that the limbs reach",
            {"proven": True, "undecided": False, "scope": "for all that the limbs reach"},
        ),
        (
            one_move(steps=6),
            "60",
            "infeasible",
            {"ok": False, "proven": False, "undecided": False, "constraint": "horizon"},
        ),
    ],
    ids=["time limit", "proof", "none found"],
)
def test_the_verdict_says_what_is_known_and_nothing_is_written(
    wall: dict[str, Any],
    limit: str,
    verdict: str,
    said: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, output = write(tmp_path, wall)
    output.write_bytes(b"an older plan")
    assert crux_plan(path, "-o", str(output), "--time-limit", limit, "--json") == 1
    out, errors = capsys.readouterr()
    assert said.items() <= json.loads(out).items()
    assert f"wall.yaml: {verdict} (" in errors
    if said.get("constraint") == "horizon":
        assert re.search(r"no plan found in 6 steps .* one in \d+.*allow as many", errors)
    assert output.read_bytes() == b"an older plan"


def test_help_says_what_the_papers_methods_are_here(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        crux_plan("--help")
    said = " ".join(capsys.readouterr().out.split())
    assert "two_block equation (19): a MIP without (8b) for contacts and an NLP with it, from a cold start" in said
    assert "multi_block P3: one such MIP for each limb" in said
    assert "the consensus includes who is in the air" in said


def test_a_missing_scenario_is_a_usage_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crux_plan(str(tmp_path / "none.yaml"), "-o", str(tmp_path / "nowhere" / "plan.mcap")) == 2
    assert "none.yaml: no such file" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--at", "3"], "--at is about a plan that runs"),
        (["--without", "left"], "--without is about a plan that runs"),
        (["--from", "plan.mcap", "--method", "auto"], "--method does not go with --from"),
        (["--from", "plan.mcap", "--prove", "5"], "--prove does not go with --from"),
    ],
)
def test_options_that_do_not_go_together_are_told(
    words: list[str], named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wall, output = write(tmp_path, two_rows())
    assert crux_plan(wall, "-o", str(output), *words) == 2
    assert named in capsys.readouterr().err
    assert not output.exists()
