"""`crux replay`: the summary on the terminal and the 3-D view's server."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.request
from dataclasses import replace
from pathlib import Path

import pytest
from crux_tools import cli
from crux_tools.telemetry import read_log
from crux_tools.telemetry.summary import summarise


def test_the_summary_in_words(log_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["replay", str(log_path), "--no-view"]) == 0
    printed, errors = capsys.readouterr()
    for words in ("plan completed, HOLDING", "CLIMBING 0.50 …", "LF to open: 1 times", "largest 5.00 mm", "LF 1.00 N"):
        assert words in printed
    assert errors == ""


def test_a_refusal_stays_in_one_line_whatever_signs_it_has(
    log_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = summarise(read_log(log_path))
    reason = "the plan is for another robot; plan it again"
    monkeypatch.setattr("crux_tools.telemetry.summary.summarise", lambda _log: replace(summary, refusals=[reason]))
    assert cli.main(["replay", str(log_path), "--no-view"]) == 0
    assert reason in capsys.readouterr().out


def test_the_summary_as_json(faulty_log_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["replay", str(faulty_log_path), "--no-view", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["ok"] is True
    assert result["cycles"] == summarise(read_log(faulty_log_path)).cycles
    assert result["faults"][0]["name"] == "body_error"
    assert result["timing"]["realtime"] is True


def test_a_killed_log_is_replayed_with_a_word_of_warning(
    killed_log_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["replay", str(killed_log_path), "--no-view"]) == 0
    printed, errors = capsys.readouterr()
    assert "CLIMBING at plan time" in printed
    assert "the log was not closed" in errors


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(500)])
def test_no_log_is_refused_in_one_line(content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    assert cli.main(["replay", str(path), "--no-view"]) == 2
    printed, errors = capsys.readouterr()
    assert printed == ""
    assert errors.count("\n") == 1
    assert str(path) in errors


def test_a_log_cut_in_its_head_is_called_cut(
    log_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(log_path.read_bytes()[:100])
    assert cli.main(["replay", str(path), "--check"]) == 2
    said = "no /control_input, /control_output, /robot_state in it: the end of the file is missing"
    assert capsys.readouterr().err == f"crux replay: {path}: {said}\n"


@pytest.mark.parametrize("port", ["-1", "65536", "http"])
def test_a_wrong_port_is_named(port: str, log_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        cli.main(["replay", str(log_path), "--port", port])
    assert stopped.value.code == 2
    assert f"'{port}' is not a port" in capsys.readouterr().err


@pytest.mark.parametrize("host", ["no-such-host.invalid", "203.0.113.7", "a..b", ""])
def test_a_host_that_cannot_be_listened_on_is_refused(host: str, log_path: Path) -> None:
    words = [sys.executable, "-m", "crux_tools.cli", "replay", str(log_path), "--host", host, "--json"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"--host {host}" in json.loads(done.stdout)["error"]


def test_the_command_serves_until_interrupted(log_path: Path) -> None:
    command = [sys.executable, "-m", "crux_tools.cli", "replay", str(log_path), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        url = line.split()[1]
        with urllib.request.urlopen(url, timeout=600) as answer:
            assert answer.status == 200
        process.send_signal(2)
        printed, errors = process.communicate(timeout=600)
        assert process.returncode == 0
        assert "plan completed" in printed
        assert "Traceback" not in errors
