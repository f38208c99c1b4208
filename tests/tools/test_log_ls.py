"""`crux log ls` on made-up logs: what it says of each, and that a log is read once."""

from __future__ import annotations

import json
import os
import random
import shutil
import sqlite3
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts import cdr
from crux_contracts.plan_file import write_plan
from crux_msgs import truth_verdict_t
from crux_tools.cli import main
from crux_tools.log import index
from crux_tools.telemetry import read_log
from crux_tools.telemetry.append import Series, append
from crux_tools.telemetry.margins import measured_margin_n
from hand_plan import standing_plan
from made_up_climb import Story, write_log

SHORT: dict[str, Any] = {"ready_cycles": 3, "wait_cycles": 0, "holding_cycles": 3}


def judge(path: Path, ok: bool, slips: int, reason: str) -> None:
    """Adds a verdict as crux climb does."""
    verdict = truth_verdict_t()
    verdict.ok, verdict.slips, verdict.largest_slip_m, verdict.reason = int(ok), slips, 0.001 * slips, reason
    verdict.goal_error_m, verdict.world, verdict.log_complete = 0.004, "windy", 1
    append(path, [Series("/truth/verdict", [10], [cdr.encode(verdict)])])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four logs, a plan, and a file that is nothing."""
    logs = tmp_path_factory.mktemp("made") / "logs"
    (logs / "deep").mkdir(parents=True)
    good = {"started_utc": "2026-11-02T08:00:00.000000Z", "host": "wall-pc", "note": "New rubber"}
    write_log(logs / "good.mcap", Story(**SHORT, metadata=good, slack=(50, 2, 3.0)))
    judge(logs / "good.mcap", True, 0, "")
    slipped = Story(**SHORT, faults=((40, 7, 1),) * 2, metadata={"started_utc": "2026-11-03T08:00:00Z"})
    write_log(logs / "deep" / "slipped.mcap", slipped)
    judge(logs / "deep" / "slipped.mcap", False, 2, "2 slips")
    write_log(logs / "robot.mcap", Story(**SHORT))
    write_log(logs / "killed.mcap", finish=False)
    write_plan(logs / "plan.mcap", standing_plan())
    (logs / "text.mcap").write_text("no log")
    return logs


@pytest.fixture
def folder(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of them; the index is the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return Path(shutil.copytree(made, tmp_path / "logs"))


def listed(capsys: pytest.CaptureFixture[str], *words: str) -> list[dict[str, Any]]:
    assert main(["log", "ls", *words, "--json"]) == 0
    found: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["logs"]
    return found


def names(found: list[dict[str, Any]]) -> list[str]:
    return [Path(each["path"]).stem for each in found]


def test_every_log_is_told_in_a_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "ls", str(folder)]) == 0
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert len(lines) == 5
    good = next(line for line in lines if line.endswith("good.mcap"))
    least = float(np.nanmin(measured_margin_n(read_log(folder / "good.mcap"), 0.008)))
    for word in ("2026-11-02 08:00", "made-up", "scaler", "climbed", f"{least:.2f} N", "New rubber"):
        assert word in good
    assert "failed: 2 slips" in next(line for line in lines if line.endswith("deep/slipped.mcap"))
    assert "unjudged: plan completed" in next(line for line in lines if line.endswith("robot.mcap"))
    assert "(not closed)" in next(line for line in lines if line.endswith("killed.mcap"))
    assert "text.mcap: not an MCAP file" in said.err
    assert said.err.strip().endswith("4 of 4 logs")


def test_what_is_listed_is_what_the_logs_say(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    by_name = dict(zip(names(found := listed(capsys, str(folder))), found, strict=True))
    slipped = by_name["slipped"]
    assert (slipped["slips"], slipped["largest_slip_m"], slipped["goal_error_m"]) == (2, 0.002, 0.004)
    assert (slipped["world"], slipped["verdict"], slipped["closed"]) == ("windy", "failed", True)
    assert len(slipped["faults"]) == 2
    assert slipped["faults"][0].startswith("7 ")
    assert slipped["faults"][0].endswith(" RF")
    assert (by_name["robot"]["slips"], by_name["robot"]["started_utc"], by_name["robot"]["note"]) == (None, None, None)
    assert by_name["killed"]["closed"] is False


CHOSEN: tuple[tuple[str, list[str]], ...] = (
    ("--verdict failed", ["slipped"]),
    ("--verdict climbed --wall MADE", ["good"]),
    ("--wall overhang", []),
    ("--host wall-pc", ["good"]),
    ("--fault rf", ["slipped"]),
    ("--note rubber", ["good"]),
    ("--since 2026-11-03", ["slipped"]),
    ("--until 2026-11-02", ["good"]),
    ("--limit 2", ["good", "slipped"]),
    ("--limit 1 --reverse", ["slipped"]),
    ("--sort slips --reverse --limit 2", ["slipped", "good"]),
    ("--sort margin --limit 1", ["good"]),
)


def test_filters_and_sorts(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, chosen in CHOSEN:
        assert names(listed(capsys, str(folder), *words.split())) == chosen, words


def test_a_log_is_read_once_until_it_changes(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []
    entry_of = index.entry_of

    def counted(path: Path) -> index.Entry | None:
        read.append(path.name)
        return entry_of(path)

    monkeypatch.setattr(index, "entry_of", counted)
    first = listed(capsys, str(folder))
    assert sorted(read) == ["good.mcap", "killed.mcap", "plan.mcap", "robot.mcap", "slipped.mcap", "text.mcap"]
    read.clear()
    assert listed(capsys, str(folder)) == first
    assert listed(capsys, str(folder / "deep")) == [each for each in first if "slipped" in each["path"]]
    assert read == []
    write_log(folder / "robot.mcap", Story(**SHORT, faults=((40, 7, 3),)))
    (folder / "good.mcap").unlink()
    again = {Path(each["path"]).stem: each for each in listed(capsys, str(folder))}
    assert read == ["robot.mcap"]
    assert again["robot"]["faults"]
    assert "good" not in again
    index.index_path().write_bytes(b"no database, but long enough to be looked at as one" * 40)
    assert len(listed(capsys, str(folder))) == 3
    assert len(read) == 6
    monkeypatch.setattr(index, "FORM", index.FORM + 1)
    read.clear()
    listed(capsys, str(folder))
    assert len(read) == 5


def test_a_damaged_index_changes_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its bytes: what it says is as if the logs had been read."""
    monkeypatch.setattr(index, "entry_of", cache(index.entry_of))
    first = listed(capsys, str(folder))
    whole, draw = index.index_path().read_bytes(), random.Random(3)
    for _ in range(150):
        damaged = bytearray(whole)
        for _ in range(draw.choice((1, 3, 20))):
            damaged[draw.randrange(len(damaged))] = draw.randrange(256)
        cut = draw.randrange(len(damaged)) if draw.random() < 0.2 else len(damaged)
        index.index_path().write_bytes(damaged[:cut])
        assert listed(capsys, str(folder)) == first


def test_an_index_with_another_table_is_made_anew(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    index.index_path().parent.mkdir(parents=True)
    with closing(sqlite3.connect(index.index_path())) as other:
        other.execute("create table logs (path text primary key, entry text)")
    assert len(listed(capsys, str(folder / "deep"))) == 1
    with closing(sqlite3.connect(index.index_path())) as made:
        assert made.execute("select count(*) from logs").fetchone() == (1,)


def test_a_log_whose_name_is_no_text_is_listed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = os.fsdecode(bytes(folder / "odd-") + b"\xff.mcap")
    shutil.copy(folder / "robot.mcap", odd)
    assert odd in [each["path"] for each in listed(capsys, str(folder))]
    assert main(["log", "ls", str(folder)]) == 0


def test_without_a_place_for_the_index_it_lists_all_the_same(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    assert len(listed(capsys, str(folder / "deep"))) == 1


def test_what_is_no_folder_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "ls", str(folder / "good.mcap")]) == 2
    assert "good.mcap: is no folder; crux log info shows a single log" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["log", "ls", "--since", "yesterday"])
    assert "expected a date such as 2026-11-22" in capsys.readouterr().err
