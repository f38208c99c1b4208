"""Wrong input to the commands: one clear message, the right exit status, nothing written, no traceback."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from broken_scenarios import CASES, SCENARIO, Case
from clear_message import check_message
from crux_tools import cli

IN_A_PROCESS = ("empty file", "100 MB", "faces z", "unreachable goal")  # the others run in this one: quicker


def test_there_are_enough_of_them() -> None:
    assert len({case.id for case in CASES}) == len(CASES) >= 30


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_a_broken_scenario(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, output = tmp_path / "broken.yaml", tmp_path / "out" / "plan.mcap"
    output.parent.mkdir()
    case.write(scenario)
    status = cli.main(["plan", str(scenario), "-o", str(output)])
    printed, errors = capsys.readouterr()
    check_message(errors, "plan", *case.names, *([str(scenario)] if case.status == 2 else []))
    assert status == case.status
    assert printed == ""
    assert list(output.parent.iterdir()) == []


@pytest.mark.parametrize("case", [case for case in CASES if case.id in IN_A_PROCESS], ids=lambda case: case.id)
def test_a_broken_scenario_in_a_process_of_its_own(case: Case, tmp_path: Path) -> None:
    scenario, output = tmp_path / "broken.yaml", tmp_path / "plan.mcap"
    case.write(scenario)
    command = [sys.executable, "-m", "crux_tools.cli", "plan", str(scenario), "-o", str(output), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    check_message(done.stderr, "plan", *case.names)
    assert done.returncode == case.status
    answer = json.loads(done.stdout)
    assert answer["ok"] is False
    assert answer["error"] in done.stderr
    assert not output.exists()


def test_the_good_scenario_is_good(plan_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """So that every case above fails for its own reason."""
    assert cli.main(["check", str(plan_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True


@pytest.mark.parametrize("output", ["missing/folder/plan.mcap", "folder", "/proc/plan.mcap"])
def test_an_output_that_cannot_be_written(output: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "folder").mkdir()
    target = tmp_path / output
    status = cli.main(["plan", str(SCENARIO), "-o", str(target)])
    _, errors = capsys.readouterr()
    check_message(errors, "plan", str(target))
    assert status == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder"]
    assert list((tmp_path / "folder").iterdir()) == []


def test_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["fly"], ["plan"], ["plan", str(SCENARIO)], ["plan", str(SCENARIO), "-o", "x", "--fast"]):
        with pytest.raises(SystemExit) as stopped:
            cli.main(words)
        assert stopped.value.code == 2
        assert "usage: crux" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
