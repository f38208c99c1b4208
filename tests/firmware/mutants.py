"""Mutants of C source: one small mistake each, of the kinds that people make."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

SWAPS = {
    "<": "<=",
    "<=": "<",
    ">": ">=",
    ">=": ">",
    "==": "!=",
    "!=": "==",
    "&&": "||",
    "||": "&&",
    "+": "-",
    "-": "+",
    "*": "/",
    "<<": ">>",
    ">>": "<<",
    "&": "|",
    "|": "&",
    "^": "&",
}
OPERATOR = re.compile(r" (<<|>>|<=|>=|==|!=|&&|\|\||[<>+\-*&|^]) ")
WORDS = {"true": "false", "false": "true"}
WORD = re.compile(r"\b(true|false)\b")
INTEGER = re.compile(r"(?<![\w.])(0x[0-9A-Fa-f]+|\d+)([uU]L?|UL)?(?![\w.])")
NEGATION = re.compile(r"!(?=[\w(])")
STATEMENT = re.compile(
    r"^(\s+)(?!(return|const|static|struct|enum|uint\w+|float|bool|size_t|else|\})\b)[^\s{}][^{}]*;$"
)


@dataclass(frozen=True)
class Mutant:
    """One changed line; `line_number` counts from 1."""

    file: str
    line_number: int
    before: str
    after: str

    @property
    def key(self) -> str:
        """Names the mutant without its line number, so that an explanation outlives an edit elsewhere."""
        return f"{self.file}: {' '.join(self.before.split())} -> {' '.join(self.after.split())}"


def _code_lines(text: str) -> Iterator[tuple[int, str]]:
    """Numbered lines of code; comments, preprocessor and tables of numbers left out."""
    for number, line in enumerate(text.splitlines(), start=1):
        code = line.split("//")[0].rstrip()
        if code.strip() and not code.lstrip().startswith(("#", "0x", "///")):
            yield number, code


def _changes(line: str) -> Iterator[str]:
    for match in OPERATOR.finditer(line):
        yield f"{line[: match.start(1)]}{SWAPS[match[1]]}{line[match.end(1) :]}"
    for match in WORD.finditer(line):
        yield f"{line[: match.start()]}{WORDS[match[0]]}{line[match.end() :]}"
    for match in INTEGER.finditer(line):
        yield f"{line[: match.start()]}{int(match[1], 0) + 1}{match[2] or ''}{line[match.end() :]}"
    for match in NEGATION.finditer(line):
        yield line[: match.start()] + line[match.end() :]
    if STATEMENT.match(line):
        yield f"{' ' * (len(line) - len(line.lstrip()))};"


def mutants(name: str, text: str) -> Iterator[Mutant]:
    """All mutants of a C file whose statements stand on lines of their own (as clang-format leaves them)."""
    for number, line in _code_lines(text):
        for changed in _changes(line):
            yield Mutant(name, number, line, changed)


def apply(mutant: Mutant, text: str) -> str:
    """The file with the mutant's line in it."""
    lines = text.splitlines()
    lines[mutant.line_number - 1] = mutant.after
    return "\n".join(lines) + "\n"
