"""Damaged plans and plans for other robots: every command that takes a plan refuses them in one line."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from clear_message import check_message
from crux_contracts.plan_file import read_plan, write_plan
from crux_msgs import plan_t
from crux_tools import cli

COMMANDS = ("check", "climb", "report", "upload")
SEED = 20221021


def _arguments(command: str, plan: Path, folder: Path) -> list[str]:
    output = {"climb": ["-o", str(folder / "log.mcap")], "report": ["-o", str(folder / "page.html")]}
    return [command, str(plan), *output.get(command, [])]


def _refused(command: str, plan: Path, folder: Path, capsys: pytest.CaptureFixture[str], *names: str) -> None:
    folder.mkdir(exist_ok=True)
    status = cli.main(_arguments(command, plan, folder))
    printed, errors = capsys.readouterr()
    check_message(errors, command, *names)
    assert status == 2
    assert printed == ""
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_no_plan(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    empty, text = tmp_path / "empty.mcap", tmp_path / "text.mcap"
    empty.touch()
    text.write_text("version: 1\n")
    for path in (empty, text, tmp_path / "missing.mcap", tmp_path):
        _refused(command, path, out, capsys, str(path))


@pytest.mark.parametrize("command", COMMANDS)
def test_a_truncated_plan(command: str, plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = plan_path.read_bytes()
    cut = tmp_path / "cut.mcap"
    for share in (0.001, 0.3, 0.6, 0.999):
        cut.write_bytes(data[: int(share * len(data))])
        _refused(command, cut, tmp_path / "out", capsys, str(cut))


def test_a_flipped_bit_anywhere(plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = plan_path.read_bytes()
    flipped = tmp_path / "flipped.mcap"
    draw = random.Random(SEED)
    for _ in range(60):
        damaged = bytearray(data)
        damaged[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        flipped.write_bytes(damaged)
        _refused("upload", flipped, tmp_path / "out", capsys, str(flipped))


def _changed(plan_path: Path, target: Path, change: Callable[[plan_t], None]) -> None:
    """A plan with a sound file around it, so that only its content can be at fault."""
    plan = read_plan(plan_path)
    change(plan)
    write_plan(target, plan)


def _rename(plan: plan_t) -> None:
    plan.robot_name = "spider"


def _rebuild(plan: plan_t) -> None:
    plan.robot_sha256 = "0" * 64


@pytest.mark.parametrize("command", ["check", "climb"])
def test_a_plan_for_a_robot_nobody_knows(
    command: str, plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.mcap"
    _changed(plan_path, other, _rename)
    _refused(command, other, tmp_path / "out", capsys, "robot", "spider", "scaler")


def test_a_plan_for_another_build_of_the_robot(
    plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.mcap"
    _changed(plan_path, other, _rebuild)
    _refused("climb", other, tmp_path / "out", capsys, "scaler", "000000000000")
    assert cli.main(["check", str(other), "--json"]) == 1
    (violation,) = json.loads(capsys.readouterr().out)["violations"]
    assert violation["constraint"] == "robot_hash"
