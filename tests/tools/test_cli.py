"""The command line itself: help, exit statuses, errors on one line, fast start."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from crux_contracts.plan_file import read_plan, write_plan
from crux_planner.errors import InfeasibleError
from crux_simulation.sim.world_file import read_world
from crux_tools.cli import COMMANDS, main
from crux_tools.paths import ROOT, built
from hand_plan import standing_plan

HEAVY = ("casadi", "mujoco", "matplotlib", "scipy", "lcm")


def crux(*words: str) -> subprocess.CompletedProcess[str]:
    """The command as a user starts it."""
    return subprocess.run([sys.executable, "-m", "crux_tools.cli", *words], capture_output=True, text=True, check=False)


def test_help_lists_every_command_and_teaches_a_first_climb() -> None:
    done = crux("--help")
    assert done.returncode == 0
    for name in COMMANDS:
        assert name in done.stdout
    assert "crux climb out/plan.mcap" in done.stdout


def test_version_is_that_of_the_project_with_the_commit_and_the_runtime_says_the_same() -> None:
    done = crux("--version")
    assert done.returncode == 0
    (version,) = re.findall(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert re.fullmatch(rf"crux {version} \(commit ([0-9a-f]{{12}}(-dirty)?|unknown.*)\)\n", done.stdout)
    runtime = subprocess.run(
        [built("runtime/app/crux-runtime"), "--version"], capture_output=True, text=True, check=True
    )
    assert runtime.stdout.split()[:2] == ["crux-runtime", version]


def test_the_changelog_has_a_dated_section_of_this_version() -> None:
    (version,) = re.findall(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    sections = re.findall(r"^## \[(.+)\] - (\d{4}-\d\d-\d\d)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert sections[0][0] == version


def test_help_and_usage_errors_load_nothing_heavy() -> None:
    code = (
        "import sys\nfrom crux_tools.cli import main\n"
        "try:\n    main(['climb', '--help'])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


def test_numpy_has_no_threads_that_spin() -> None:
    """Once a command has loaded it, whatever the number of cores."""
    code = "from crux_tools.cli import main; main(['check', 'no-such-plan.mcap'])"
    code += "; import os, sys; assert 'numpy' in sys.modules; print(len(os.listdir('/proc/self/task')))"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "1"


@pytest.mark.parametrize("words", [[], ["fly"], ["climb"], ["climb", "x.mcap", "-o", "y.mcap", "--pace", "slow"]])
def test_wrong_usage_is_exit_status_two(words: list[str]) -> None:
    done = crux(*words)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


def _broken_files(folder: Path) -> list[Path]:
    good = folder / "good.mcap"
    write_plan(good, standing_plan())
    data = good.read_bytes()
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 0x10
    contents = {"empty": b"", "text": b"not a plan\n", "short": data[: len(data) // 2], "flipped": bytes(flipped)}
    for name, content in contents.items():
        (folder / f"{name}.mcap").write_bytes(content)
    return [folder / f"{name}.mcap" for name in contents] + [folder / "missing.mcap", folder]


def test_plans_that_are_none_end_with_one_line_and_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "out" / "log.mcap"
    for number, path in enumerate(_broken_files(tmp_path)):
        words = ["climb", str(path), "-o", str(log), "--json"]
        if number == 0:
            done = crux(*words)
            status, printed, errors = done.returncode, done.stdout, done.stderr
        else:  # in this process: quicker
            status, (printed, errors) = main(words), capsys.readouterr()
        assert status == 2, (path, errors)
        assert len(errors.strip().splitlines()) == 1, errors
        answer = json.loads(printed)
        assert answer["ok"] is False
        assert str(path) in answer["error"]
        assert not log.parent.exists()


def test_an_unforeseen_error_is_one_line_with_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks(*_: object) -> int:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("crux_tools.operator_commands.run_status", breaks)
    assert main(["status"]) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "ZeroDivisionError: by zero (at test_cli.py:" in lines[0]


def test_interrupted_by_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("crux_tools.operator_commands.run_status", interrupt)
    assert main(["status"]) == 130


def _leaves(parser: argparse.ArgumentParser, words: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """A command, and all that hang below it, by their words."""
    yield words, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from _leaves(below, f"{words} {name}")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_teaches_by_an_example(name: str) -> None:
    parser = argparse.ArgumentParser()
    command = COMMANDS[name]
    below = parser.add_subparsers()
    getattr(importlib.import_module(command.module), command.adder)(below)
    for words, leaf in _leaves(below.choices[name], f"crux {name}"):
        lines = [line.strip().removeprefix("sudo .venv/bin/") for line in (leaf.epilog or "").splitlines()]
        assert any(line.startswith(words) for line in lines), words


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["climb", "p.mcap", "-o", "l.mcap", "--seed", "-1"], "--seed: '-1': expected a whole number, 0 or more"),
        (["bench", "table2", "--count", "0"], "--count: '0': expected a whole number, 1 or more"),
        (["bench", "fields", "--limit", "nan"], "--limit: 'nan': expected a number above 0"),
        (["can", "check", "--measure", "soon"], "--measure: 'soon': expected a number above 0"),
        (["plan", "wall.yaml", "-o", "p.mcap", "--method", "best"], "--method: invalid choice: 'best'"),
        (["plan", "wall.yaml", "-o", "p.mcap", "--from", "o.mcap", "--at", "nan"], "--at: 'nan': expected a number"),
    ],
)
def test_numbers_that_cannot_be_are_refused_before_anything_runs(
    words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert stopped.value.code == 2
    assert named in capsys.readouterr().err


def test_every_mistake_of_a_file_has_a_line_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, faults = tmp_path / "plan.mcap", tmp_path / "faults.yaml"
    write_plan(plan, standing_plan())
    faults.write_text("fault: []\n")
    assert main(["climb", str(plan), "-o", str(tmp_path / "log.mcap"), "--faults", str(faults), "--json"]) == 2
    said = capsys.readouterr()
    assert len(said.err.strip().splitlines()) == 2
    assert json.loads(said.out)["error"].count("faults.yaml:1: ") == 2


def test_a_world_that_does_not_fit_the_plan_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, world, log = tmp_path / "plan.mcap", tmp_path / "world.yaml", tmp_path / "log.mcap"
    write_plan(plan, standing_plan())
    words = ["climb", str(plan), "-o", str(log), "--world", str(world)]
    assert main(words) == 2
    assert f"{world}: no such file" in capsys.readouterr().err
    world.write_text("version: 1\nname: x\nholds:\n  h8: {present: false}\n  h1: {friction: rough}\n")
    assert main(words) == 2
    assert "world.yaml:5: holds.h1.friction" in capsys.readouterr().err
    world.write_text("version: 1\nname: x\nholds:\n  h8: {present: false}\n")
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "world.yaml:4: holds.h8: no such hold in the plan" in said
    assert "Traceback" not in said
    assert main([*words[:4], "--world-seed", "3"]) == 2
    assert "give --world" in capsys.readouterr().err
    assert main([*words, "--drawn-world", str(world)]) == 2  # the world itself
    assert not log.exists()


def test_a_climb_writes_its_world_with_all_numbers_drawn(tmp_path: Path) -> None:
    plan, world, drawn = (tmp_path / name for name in ("plan.mcap", "world.yaml", "drawn.yaml"))
    write_plan(plan, standing_plan())
    world.write_text("version: 1\nname: x\nholds: {all: {offset_m: {normal: [0, 0.001]}}}\n")
    words = ["climb", str(plan), "-o", str(tmp_path / "log.mcap"), "--world"]
    assert main([*words, str(world), "--world-seed", "4", "--drawn-world", str(drawn)]) == 0
    made = read_plan(plan)
    assert read_world(drawn).draw(0, made).holds == read_world(world).draw(4, made).holds


def test_a_report_is_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "plan.mcap"
    write_plan(plan, standing_plan())
    assert main(["report", str(plan), "-o", str(tmp_path)]) == 2
    assert f"{tmp_path}: is a folder" in capsys.readouterr().err


def test_a_bench_whose_problem_has_no_plan_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(_options: argparse.Namespace) -> int:
        raise InfeasibleError("time limit", "no time was left")

    monkeypatch.setattr("crux_simulation.benchmarks.figure6.run", run)
    assert main(["bench", "fig6"]) == 1
    assert capsys.readouterr().err.strip() == "crux bench: no time was left"


def test_a_package_that_is_not_installed_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As after `make climb`, which installs none of what campaigns alone need."""
    monkeypatch.setitem(sys.modules, "dask", None)
    for module in ("cluster", "engine"):
        monkeypatch.delitem(sys.modules, f"crux_simulation.campaign.{module}", raising=False)
    spec = ROOT / "examples" / "four-hold-walls.yaml"
    assert main(["campaign", str(spec), "--out", str(tmp_path / "out")]) == 2
    assert "crux campaign: needs dask, which is not installed: make extras\n" in capsys.readouterr().err
