"""The commands that pages give: lines of their ```sh blocks, and `commands` in running text."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from crux_tools import cli
from crux_tools.paths import ROOT
from test_readme import PAGES

TOLD_ELSEWHERE = ("CHANGELOG.md", "CODE_OF_CONDUCT.md")  # what was new in which version: not how to do something
PROGRAMS = {"apt-get", "cmake", "crux", "crux-runtime", "ctest", "dask", "install", "ip", "journalctl", "make", "pip"}
PROGRAMS |= {"pre-commit", "pytest", "python", "systemctl", "ulimit"}
FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```", re.MULTILINE | re.DOTALL)
# What stands for something of the reader's, and what a test gives for it.
EXAMPLES = {
    "PLAN": "out/my-wall.mcap",
    "PLAN.mcap": "out/my-wall.mcap",
    "LOG": "out/climb.mcap",
    "LOG.mcap": "out/climb.mcap",
    "A": "out/climb.mcap",
    "B": "out/climb.mcap",
    "SCENARIO": "my-wall.yaml",
    "DIR": "out",
    "TEXT": "words",
    "S": "1",
}


@dataclass(frozen=True)
class Command:
    """A command of a page: its words, without sudo and folders of programs, and where its output goes."""

    page: str
    words: tuple[str, ...]
    output: str
    in_block: bool

    @property
    def text(self) -> str:
        """As the reader types it."""
        return " ".join(self.words) + (f" > {self.output}" if self.output else "")

    def filled(self) -> list[str]:
        """Its words with examples in the places that the reader fills in."""
        return [EXAMPLES.get(word, word) for word in self.words]


def pages() -> list[Path]:
    """The pages that say how to do something."""
    return [page for page in PAGES if page.name not in TOLD_ELSEWHERE]


def simple_commands(line: str) -> Iterator[tuple[list[str], str]]:
    """The commands of a line of a shell, with where the output of each goes; without comments."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars="();<>|&")
    lexer.whitespace_split = True
    words: list[str] = []
    output = ""
    for word in [*lexer, ";"]:
        if word == ">":
            output = ">"
        elif set(word) <= set("();<>|&"):
            if words:
                yield words, output
            words, output = [], ""
        elif output == ">":
            output = word
        else:
            words.append(word)


def _commands(page: str, text: str, in_block: bool) -> Iterator[Command]:
    """Of lines of a shell."""
    for line in text.replace("\\\n", " ").splitlines():
        for words, output in simple_commands(line):
            first = words.index("sudo") + 1 if "sudo" in words else 0
            yield Command(page, (Path(words[first]).name, *words[first + 1 :]), output, in_block)


def block_commands(page: str, text: str, program: str) -> Iterator[Command]:
    """The commands of lines that begin with a program, among others."""
    lines = [line for line in text.replace("\\\n", " ").splitlines() if re.match(rf"\s*{program} ", line)]
    return (command for command in _commands(page, "\n".join(lines), True) if command.words[0] == program)


def page_commands(page: Path) -> Iterator[Command]:
    """Every command of a page, in its order. Words in [brackets] are left out, for they need not be given."""
    name, text = str(page.relative_to(ROOT)), page.read_text(encoding="utf-8")
    spans = FENCE.sub("", text)
    for _, language, block in FENCE.findall(text):
        if language == "sh":
            yield from _commands(name, block, True)
    for span in re.findall(r"`([^`\n]+)`", spans):
        typed = re.sub(r"\[[^]]*\]|…", "", span)
        if re.match(rf"(?:sudo )?(?:\S*/)?(?:{'|'.join(PROGRAMS)}) ", typed) and typed.count('"') % 2 == 0:
            yield from (command for command in _commands(name, typed, False) if command.words[0] in PROGRAMS)


def unlabelled(page: Path) -> list[str]:
    """Lines in blocks of another language, or of none, that read like commands."""
    blocks = [block for _, language, block in FENCE.findall(page.read_text(encoding="utf-8")) if language != "sh"]
    start = re.compile(rf"\s*(?:sudo )?(?:\.venv/bin/)?(?:{'|'.join(PROGRAMS)}) [a-z./-]")
    return [line for block in blocks for line in block.splitlines() if start.match(line)]


class _Missing(Exception):
    """What argparse says."""


def misunderstood(words: list[str]) -> str | None:
    """What `crux` says of words that it does not understand; None where it does."""
    if words[0] not in cli.COMMANDS:
        return None if words[0] == "--help" else f"no command {words[0]}"
    said: list[str] = []

    def error(_self: argparse.ArgumentParser, message: str) -> None:
        said.append(message)
        raise _Missing(message)

    before = argparse.ArgumentParser.error
    argparse.ArgumentParser.error = error  # type: ignore[method-assign,assignment]
    try:
        cli.parser_with({words[0]}).parse_args(words)
    except _Missing:
        return said[0]
    except SystemExit:  # --help
        return None
    finally:
        argparse.ArgumentParser.error = before  # type: ignore[method-assign]
    return None
