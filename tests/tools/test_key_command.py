"""`crux key`: a key nobody else may read, and its line."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from crux_tools.cli import main


@pytest.fixture(autouse=True)
def key_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path / "config" / "crux" / "operator.pem"


def test_a_new_key_is_its_owners_alone_and_shown_again(key_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "new", "--name", "ann"]) == 0
    out, err = capsys.readouterr()
    assert re.fullmatch(r"[0-9a-f]{64} operate ann\n", out)
    assert str(key_file) in err
    assert key_file.stat().st_mode & 0o777 == 0o600
    assert key_file.parent.stat().st_mode & 0o777 == 0o700
    assert main(["key", "show", "--name", "ann"]) == 0
    assert capsys.readouterr().out == out
    assert main(["key", "show", "--role", "watch", "--name", "wall", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"ok": True, "file": str(key_file), "line": f"{out.split()[0]} watch wall"}


def test_a_key_that_is_there_stays(key_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "new"]) == 0
    before = key_file.read_bytes()
    assert main(["key", "new"]) == 2
    assert "is there already and stays" in capsys.readouterr().err
    assert key_file.read_bytes() == before


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660])
def test_a_key_that_others_may_read_is_refused(key_file: Path, mode: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "new"]) == 0
    key_file.chmod(mode)
    assert main(["key", "show"]) == 2
    assert f"others may read this key (mode {mode:o}); chmod 600 {key_file}" in capsys.readouterr().err


def test_what_is_no_key_is_refused(key_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "show"]) == 2
    assert f"{key_file}: there is no key; `crux key new` makes one" in capsys.readouterr().err
    key_file.parent.mkdir(parents=True)
    key_file.write_text("no key")
    key_file.chmod(0o600)
    assert main(["key", "show"]) == 2
    assert "no private key in PEM" in capsys.readouterr().err
    key_file.unlink()
    assert main(["key", "new", "--name", "two words"]) == 2
    assert "one word" in capsys.readouterr().err
    assert not key_file.exists()
