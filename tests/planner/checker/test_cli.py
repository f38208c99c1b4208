"""crux check: exit statuses, JSON keys, and words for people."""

import argparse
import json
import re
from pathlib import Path

import pytest
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import robot_names
from crux_planner.checker import cli
from crux_planner.checker.report import PeakTorque

from . import synthetic
from .broken import E, push


def crux_check(*words: str) -> int:
    parser = argparse.ArgumentParser()
    cli.add_check_parser(parser.add_subparsers())
    args = parser.parse_args(["check", *words])
    return int(args.func(args))


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.mcap"
    write_plan(path, synthetic.make_plan())
    return path


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    plan = synthetic.make_plan()
    push(plan, 5, 0, 1, 40.0 * E)
    path = tmp_path / "bad.mcap"
    write_plan(path, plan)
    return path


def test_a_good_plan(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crux_check(str(good), "--json") == 0
    out = json.loads(capsys.readouterr().out)
    assert out["ok"] is True
    assert out["violations"] == []
    assert out["min_margin"]["friction"] > 0.0
    assert isinstance(out["min_margin"]["tumble_m"], float)


def test_a_bad_plan(bad: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crux_check(str(bad), "--json") == 1
    out = json.loads(capsys.readouterr().out)
    assert out["ok"] is False
    found = {v["constraint"]: v for v in out["violations"]}
    assert found["force_balance"]["amount"] == pytest.approx(40.0 * E.max())
    assert set(found["force_balance"]) >= {"constraint", "limb", "finger", "time_s", "amount", "unit"}


def test_a_joint_that_is_asked_for_more_than_it_has() -> None:
    line = cli._torque_line(PeakTorque("LR", "LR_joint2", 202.0, 15.05, 12.0))
    assert "LR_joint2 carries 15.1 of 12 N m at 202.00 s: it gives way there" in line


def test_words_for_people(good: Path, bad: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crux_check(str(good)) == 0
    text = capsys.readouterr().out
    assert "passes" in text
    assert re.search(r"^least margin of the limit surface \d+\.\d\d N with the plan's squeeze$", text, re.MULTILINE)
    assert "true centre of mass" in text
    assert "gives way" not in text
    assert crux_check(str(bad)) == 1
    text = capsys.readouterr().out
    assert "fails" in text
    assert "force_balance" in text
    assert "joint6" in text


@pytest.mark.parametrize("content", [b"", b"not a plan", None])
def test_files_that_cannot_be_read(tmp_path: Path, content: bytes | None, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "plan.mcap"
    if content is not None:
        path.write_bytes(content)
    assert crux_check(str(path)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert str(path) in captured.err
    assert crux_check(str(path), "--json") == 2
    assert json.loads(capsys.readouterr().out)["ok"] is False


def test_a_truncated_plan(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good.write_bytes(good.read_bytes()[:-200])
    assert crux_check(str(good)) == 2
    assert str(good) in capsys.readouterr().err


def test_a_plan_for_an_unknown_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = synthetic.make_plan()
    plan.robot_name = "nobody"
    path = tmp_path / "plan.mcap"
    write_plan(path, plan)
    assert crux_check(str(path)) == 2
    assert f"expected one of {', '.join(robot_names())}" in capsys.readouterr().err
