"""The docs site: what it says of itself, and that it can be made (where `make docs` has installed its generator)."""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from crux_tools import cli
from crux_tools.paths import ROOT
from test_readme import PAGES

SOURCES = ("planner", "runtime", "firmware", "tools", "msgs")
READERS = ["Plan a climb", "Operate a robot", "Find a cause", "Change crux"]
GENERATOR = ROOT / ".venv-docs" / "bin" / "python"
CITED = re.compile(r"(?:(?i:equations?|of|and|to|by|satisf\w+|bounds?|under)) \((\d+[a-c]?)\)")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("docs") / "source"
    subprocess.run([sys.executable, ROOT / "docs" / "site" / "pages.py", folder], check=True)
    return folder


def test_every_equation_that_code_cites_is_explained() -> None:
    explained = (ROOT / "docs" / "mathematics.md").read_text(encoding="utf-8")
    cited: dict[str, Path] = {}
    for folder in SOURCES:
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in {".py", ".hpp", ".cpp", ".h", ".c"}:
                cited |= dict.fromkeys(CITED.findall(path.read_text(encoding="utf-8")), path)
    assert {"2", "8b", "9a", "14", "19a"} <= set(cited)
    missing = {number: path for number, path in cited.items() if f"({number})" not in explained}
    assert not missing


def test_every_fault_has_its_page(pages: Path) -> None:
    for fault in yaml.safe_load((ROOT / "msgs" / "faults.yaml").read_text(encoding="utf-8"))["faults"]:
        page = (pages / "faults" / f"{fault['name']}.md").read_text(encoding="utf-8")
        for key in ("text", "cause", "do"):
            assert fault[key][1:] in page
        assert f"[{fault['name']}]({fault['name']}.md)" in (pages / "faults" / "index.md").read_text(encoding="utf-8")


def test_commands_and_frames_are_all_there(pages: Path) -> None:
    commands = (pages / "commands.md").read_text(encoding="utf-8")
    for name, command in cli.COMMANDS.items():
        assert f"## crux {name}\n" in commands, command
        assert f"usage: crux {name}" in commands
    frames = (pages / "can" / "frames.md").read_text(encoding="utf-8")
    signals = set(re.findall(r"^ SG_ (\w+)", (ROOT / "msgs" / "can" / "crux.dbc").read_text(), re.MULTILINE))
    assert {name for name in signals if f"`{name}`" not in frames} == set()


@pytest.mark.skipif(not GENERATOR.exists(), reason="make docs has not installed its generator")
def test_the_site_has_no_warning_and_needs_no_network(pages: Path, tmp_path: Path) -> None:
    words = [GENERATOR, "-m", "sphinx", "-q", "-W", "--keep-going", "-c", ROOT / "docs" / "site", pages, tmp_path]
    environment = {"PYTHONPATH": ":".join(filter(None, sys.path)), "PATH": "/usr/bin:/bin"}
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    landing = (tmp_path / "index.html").read_text(encoding="utf-8")
    for shown in ("climb.png", "data-flow.svg", "landing.css"):
        assert re.search(rf'(?:src|href)="[^"]*{re.escape(shown)}', landing), shown
    assert re.findall(r'<div class="reader[^"]*">\s*<p><strong>([^<]+)', landing) == READERS
    assert "make climb" in re.sub(r"<[^>]+>", "", landing)
    for page in tmp_path.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(?:script|img|iframe)[^>]* src=\"(?:https?:)?//", text), page.name
        assert not re.search(r"<link[^>]* href=\"(?:https?:)?//", text), page.name


def command_lines(text: str) -> Iterator[list[str]]:
    """The `crux` commands, word by word, in lines that can be typed."""
    for line in text.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars="();<>|&")
        lexer.whitespace_split = True
        if not re.match(r"\s*(?:sudo )?(?:\.venv/bin/)?crux ", line):
            continue
        command: list[str] = []
        for word in [*lexer, ";"]:
            if set(word) <= set("();<>|&"):
                start = 1 if command[:1] == ["sudo"] else 0
                if command[start : start + 1] and Path(command[start]).name == "crux":
                    yield command[start + 1 :]
                command = []
            else:
                command.append(word)


def examples_in_help(parser: argparse.ArgumentParser) -> Iterator[str]:
    yield parser.epilog or ""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from examples_in_help(below)


def test_every_command_that_can_be_typed_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    pages = {
        page: re.findall(r"```(?:sh|text)?\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL) for page in PAGES
    }
    texts = [(str(page), block) for page, blocks in pages.items() for block in blocks]
    texts += [("--help", text) for text in examples_in_help(cli.parser_with(cli.COMMANDS))]
    commands = [(where, words) for where, text in texts for words in command_lines(text)]
    assert len(commands) > 100
    wrong = []
    for where, words in commands:
        try:
            cli.parser_with({words[0]}).parse_args(words)
        except SystemExit as stopped:
            if stopped.code:
                wrong.append(f"{where}: crux {' '.join(words)}: {capsys.readouterr().err.splitlines()[-1]}")
    assert not wrong, "\n".join(wrong)
