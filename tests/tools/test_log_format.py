"""A log of a newer format than this crux knows: read as far as it goes, and every reader says so in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from crux_contracts.channels import LOG_FORMAT
from crux_msgs.tables import SCHEMAS
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry import LogError, read_log
from made_up_climb import Story, write_log

SHORT: dict[str, Any] = {"ready_cycles": 3, "wait_cycles": 0, "holding_cycles": 3}
NEWER = {"format": str(LOG_FORMAT + 1), "version": "9.1.0", "commit": "abcdef"}
SENTENCE = (
    f"the log is of format {LOG_FORMAT + 1} (written by crux 9.1.0, commit abcdef), this crux knows formats up to "
    f"{LOG_FORMAT}: a newer one shows all of it"
)


def written(path: Path, metadata: dict[str, str]) -> Path:
    write_log(path, Story(**SHORT, metadata=metadata))
    return path


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_every_reader_says_so_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, page = written(tmp_path / "climb.mcap", NEWER), tmp_path / "page.html"
    commands = (
        ("replay", str(log), "--no-view"),
        ("log", "info", str(log)),
        ("log", "export", str(log), "-o", str(tmp_path / "seen.mcap"), "--foxglove"),
        ("report", str(log), "-o", str(page)),
    )
    for words in commands:
        assert main(list(words)) == 0
        said = capsys.readouterr().err + (page.read_text() if words[0] == "report" else "")
        assert said.count(SENTENCE) == 1, words


@pytest.mark.parametrize("number", [{}, {"format": "1"}, {"format": str(LOG_FORMAT)}, {"format": "new"}])
def test_of_other_logs_nothing_is_said(number: dict[str, str], tmp_path: Path) -> None:
    assert read_log(written(tmp_path / "climb.mcap", number)).notes == []


def test_what_cannot_be_read_is_told_with_its_cause(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name, definition = SCHEMAS["control_input_t"]
    monkeypatch.setitem(SCHEMAS, "control_input_t", (name, definition.replace("int64 cycle\n", "")))
    log = written(tmp_path / "climb.mcap", NEWER)
    with pytest.raises(LogError) as caught:
        read_log(log)
    assert str(caught.value).endswith(f"/control_input has no cycle: written by another crux?; {SENTENCE}")
    monkeypatch.undo()
    with pytest.raises(UsageError) as refused:
        recompute(log)
    assert str(refused.value) == f"{log}: {SENTENCE}"
