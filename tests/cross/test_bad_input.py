"""Wrong input to the commands: one clear message, the right exit status, nothing written, no traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from broken_scenarios import CASES, SCENARIO, Case
from clear_message import check_message
from crux_tools import cli

IN_A_PROCESS = ("faces z", "unreachable goal")  # all others run in this one: quicker
IN_A_SWEEP = ("empty file", "100 MB")


def test_there_are_enough_of_them() -> None:
    assert len({case.id for case in CASES}) == len(CASES) >= 30


LONG = {"horizon too short"}  # planner/pipeline/test_plan_cli.py has the same of a smaller wall


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=case.id, marks=[pytest.mark.sweep] * (case.id in LONG)) for case in CASES]
)
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


@pytest.mark.parametrize(
    "case",
    [
        *(case for case in CASES if case.id in IN_A_PROCESS),
        *(pytest.param(case, marks=pytest.mark.sweep) for case in CASES if case.id in IN_A_SWEEP),
    ],
    ids=lambda case: case.id,
)
def test_a_broken_scenario_in_a_process_of_its_own(case: Case, tmp_path: Path) -> None:
    scenario, output = tmp_path / "broken.yaml", tmp_path / "plan.mcap"
    case.write(scenario)
    command = [sys.executable, "-m", "crux_tools.cli", "plan", str(scenario), "-o", str(output), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
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


def written(folder: Path) -> dict[Path, tuple[int, int, int, int]]:
    """What stands in a folder, and what would tell a write; reading moves st_atime alone."""
    stats = {path: path.stat() for path in folder.iterdir()}
    return {path: (stat.st_ino, stat.st_mode, stat.st_size, stat.st_mtime_ns) for path, stat in stats.items()}


@pytest.mark.parametrize("output", ["folder", "/proc/plan.mcap", "file/plan.mcap", "pipe", "locked", "scenario.yaml"])
def test_an_output_that_cannot_be_written_is_refused_before_the_work(
    output: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("a file")
    (tmp_path / "scenario.yaml").write_bytes(SCENARIO.read_bytes())
    (tmp_path / "locked").symlink_to("/proc/version")
    os.mkfifo(tmp_path / "pipe")
    before = written(tmp_path)
    monkeypatch.setattr("crux_planner.pipeline.entry.plan", lambda *_, **__: pytest.fail("it planned"))
    target = tmp_path / output
    status = cli.main(["plan", str(tmp_path / "scenario.yaml"), "-o", str(target)])
    _, errors = capsys.readouterr()
    check_message(errors, "plan", f"-o {target}")
    assert status == 2
    assert written(tmp_path) == before


OVER_ITS_INPUT = (
    ("climb", "{plan}", "-o", "{plan}"),
    ("climb", "{plan}", "-o", "{folder}/log.mcap", "--report", "{hard_link}"),
    ("climb", "{plan}", "-o", "{folder}/log.mcap", "--report", "{folder}/log.mcap"),
    ("report", "{plan}", "-o", "{plan}"),
    ("report", "{plan}", "-o", "{folder}/plan.html", "--picture", "{link}"),
    ("plan", str(SCENARIO), "--from", "{plan}", "-o", "{link}"),
    ("can", "sign", "{plan}", "--kind", "joint", "--firmware-version", "0.2.0", "--key", "key.pem", "-o", "{plan}"),
)


@pytest.mark.parametrize("words", OVER_ITS_INPUT, ids=" ".join)
def test_no_command_writes_over_its_own_input(
    words: tuple[str, ...], plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {name: tmp_path / f"{name}.mcap" for name in ("plan", "link", "hard_link")}
    places["plan"].write_bytes(plan_path.read_bytes())
    places["link"].symlink_to(places["plan"])
    places["hard_link"].hardlink_to(places["plan"])
    status = cli.main([word.format(folder=tmp_path, **places) for word in words])
    assert status == 2
    check_message(capsys.readouterr().err, words[0], "name another file")
    assert places["plan"].read_bytes() == plan_path.read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {"plan.mcap", "link.mcap", "hard_link.mcap"}


ONE_AFTER_THE_OTHER = """
import json, sys
from crux_tools.cli import main
for words in json.load(sys.stdin):
    main(words)
    for stream in (sys.stdout, sys.stderr):
        print(end="\\f", file=stream, flush=True)
"""


@pytest.mark.parametrize(
    ("name", "report"),
    [
        pytest.param("H\u00fctte", True, id="umlaut", marks=pytest.mark.sweep),
        pytest.param(os.fsdecode(b"\xff"), True, id="no UTF-8, a report", marks=pytest.mark.sweep),
        pytest.param(os.fsdecode(b"\xff"), False, id="no UTF-8"),
    ],
)
def test_a_path_that_the_terminal_cannot_show_is_shown_in_escapes(
    name: str, report: bool, plan_path: Path, tmp_path: Path
) -> None:
    """In a process of its own, whose standard streams have no sign but those of ASCII."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / "plan.mcap").write_bytes(plan_path.read_bytes())
    plan, page = folder / "plan.mcap", folder / "plan.html"
    commands = [
        ["check", plan],
        ["check", folder / "none.mcap"],
        ["view", folder / "none.mcap"],
        *[["report", plan, "-o", page]] * report,
    ]
    done = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_THE_OTHER],
        input=json.dumps([[str(word) for word in words] for words in commands]),
        capture_output=True,
        encoding="ascii",
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        check=True,
    )
    said = [out + err for out, err in zip(done.stdout.split("\f"), done.stderr.split("\f"), strict=True)]
    assert len(said) == len(commands) + 1
    for words in said[:-1]:
        assert "internal error" not in words, words
        assert ascii(name)[1:-1] in words
    assert page.is_file() == report


def test_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["fly"], ["plan"], ["plan", str(SCENARIO)], ["plan", str(SCENARIO), "-o", "x", "--fast"]):
        with pytest.raises(SystemExit) as stopped:
            cli.main(words)
        assert stopped.value.code == 2
        assert "usage: crux" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
