"""What came over the network or out of a file commands no terminal where it is printed, nor looks like our line."""

from __future__ import annotations

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from crux_contracts.terminal import in_a_line, plain
from crux_msgs import acknowledgement_t, status_t
from crux_tools import operator_link
from crux_tools.cli import main
from crux_tools.telemetry.wording import judged
from hypothesis import given
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[2]
EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnp.exe\x7f\b\r\ncrux hold: done"
PRINTS = {"crux_contracts/terminal.py", "crux_tools/completion.py"}  # the one place, and a script for a shell


@given(st.text())
def test_plain_text_commands_no_terminal_and_loses_nothing(text: str) -> None:
    shown = plain(text)
    assert not set(shown) & {chr(code) for code in (*range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\n\t"}
    assert len(in_a_line(text).splitlines()) <= 1
    letters = "".join(sign for sign in text if sign.isalnum())
    assert [sign for sign in letters if sign not in shown] == []


def printed_otherwise(tree: ast.AST) -> Iterator[int]:
    """Lines with a print() of anything but JSON, which escapes by itself."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
            first = node.args[0] if node.args else None
            if not (isinstance(first, ast.Call) and ast.unparse(first.func) == "json.dumps"):
                yield node.lineno


def test_every_line_is_printed_by_the_one_function() -> None:
    packages = ("msgs/python/crux_contracts", "planner/crux_planner", "tools/crux_tools", "tools/crux_simulation")
    files = {path for package in packages for path in (ROOT / package).rglob("*.py")}
    found = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in files
        if "/".join(path.parts[-2:]) not in PRINTS
        for line in printed_otherwise(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert found == []


def commands_no_terminal(said: str) -> None:
    assert "owned" in said
    assert not any(ord(sign) < 0x20 and sign not in "\n\t" for sign in said), said
    assert not set("\x7f\x9b\u202e") & set(said), said
    assert not any(line.startswith("crux hold: done") for line in said.splitlines()), said


class Liar(operator_link.OperatorLink):
    """Answers whatever it is asked with text of an enemy."""

    def __init__(self, *_: Any, **__: Any) -> None:
        self.status = status_t()
        self.status.lease_holder = EVIL

    def __exit__(self, *_: object) -> None:
        pass

    def command(self, *_: Any, **__: Any) -> acknowledgement_t:
        answer = acknowledgement_t()
        answer.verdict = self.verdict
        answer.reason, answer.plan_id = EVIL, EVIL
        return answer

    verdict = acknowledgement_t.REFUSED


@pytest.mark.parametrize("verdict", [acknowledgement_t.REFUSED, acknowledgement_t.ACCEPTED])
def test_what_a_runtime_says_commands_no_terminal(
    verdict: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(operator_link, "OperatorLink", Liar)
    monkeypatch.setattr(Liar, "verdict", verdict)
    main(["status"])
    commands_no_terminal("".join(capsys.readouterr()))


@pytest.mark.parametrize("words", [("log", "info"), ("log", "ls")])
def test_what_a_log_says_commands_no_terminal(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "owned.mcap"
    shutil.copy(sorted((ROOT / "tests" / "tools" / "logs").glob("*.mcap"))[-1], log)
    assert main(["log", "note", str(log), EVIL]) == 0
    capsys.readouterr()
    main([*words, str(tmp_path if words[1] == "ls" else log)])
    commands_no_terminal("".join(capsys.readouterr()))


def test_what_a_judge_says_commands_no_terminal() -> None:
    verdict = SimpleNamespace(
        slips=0, largest_slip_m=0.0, fell=True, fall_reason=EVIL, link_contact_force_n=0.0, log_complete=True
    )
    commands_no_terminal("\n".join(judged(verdict)))
