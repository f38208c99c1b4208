"""YAML for files that people write by hand: every value knows its line, and every oddity is refused by name.

Numbers follow YAML 1.2 (`1e-3` is a number, `1:30` and `yes` are texts). Refused: anchors and aliases, tags, several
documents, duplicate keys, keys that are not texts, nesting deeper than MAX_DEPTH, files above MAX_BYTES.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import yaml

MAX_BYTES = 1_000_000
MAX_DEPTH = 16
MAX_PROBLEMS = 20

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_MAX_DIGITS = 18
_COMPILED: type | None = getattr(yaml, "CSafeLoader", None)  # where PyYAML was built with libyaml
_ASCII = {"Pd": "'-'", "Zs": "space"}  # what was meant by a sign, by its Unicode category
_ASCII_OF = {"\u2212": "'-'", "\u2018": '"\'"', "\u2019": '"\'"', "\u201c": "'\"'", "\u201d": "'\"'"}

Scalar = str | int | float | bool | None
Plain = Scalar | list["Plain"] | dict[str, "Plain"]


def pasted_sign(text: str) -> str:
    """What to write for a sign that looks like one of ASCII, as word processors and web pages have it; empty: none."""
    for sign in filter(lambda sign: not sign.isascii(), text):
        category = unicodedata.category(sign)
        meant = _ASCII_OF.get(sign) or _ASCII.get(category)
        if meant or category == "Cf":  # invisible
            name = f"U+{ord(sign):04X} {unicodedata.name(sign, 'without a name')}"
            return f"{name} is in it: {f'write an ASCII {meant}' if meant else 'leave it out'}"
    return ""


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a file. `key` is a path like holds[2].size_m[0], empty for the file as a whole. `file` is
    another file than the one that was read first.
    """

    key: str
    value: str
    expected: str
    line: int | None = None
    file: str = ""

    def text(self, path: str) -> str:
        """file:line: key: value: what would be right."""
        path = self.file or path
        place = path if self.line is None else f"{path}:{self.line}"
        expected = "; ".join(filter(None, (self.expected, pasted_sign(self.key + self.value))))
        return ": ".join(part for part in (place, self.key, self.value, expected) if part)


class DocumentError(Exception):
    """A file that says something wrong; str() has one line a problem, at most MAX_PROBLEMS of them."""

    def __init__(self, path: str, problems: list[Problem]) -> None:
        self.path = path
        self.problems = problems
        lines = [problem.text(path) for problem in problems[:MAX_PROBLEMS]]
        if len(problems) > MAX_PROBLEMS:
            lines.append(f"{path}: and {len(problems) - MAX_PROBLEMS} problems more")
        super().__init__("\n".join(lines))

    @property
    def key(self) -> str:
        """Of the first problem."""
        return self.problems[0].key

    @property
    def value(self) -> str:
        """Of the first problem."""
        return self.problems[0].value

    @property
    def expected(self) -> str:
        """Of the first problem."""
        return self.problems[0].expected


@dataclass(frozen=True)
class Node:
    """A value of the file with its place. `content` is a scalar, a list of nodes or a mapping of nodes by key."""

    content: Scalar | list[Node] | dict[str, Node]
    key: str
    line: int
    source: str = ""

    def shown(self) -> str:
        """The value as the file has it, short enough for a message."""
        if isinstance(self.content, dict):
            return "a mapping" if self.content else "an empty mapping"
        if isinstance(self.content, list):
            return f"a list of {len(self.content)}"
        if self.content is None:
            return "nothing"
        text = self.source if len(self.source) <= 60 else self.source[:57] + "..."
        return f'"{text}"' if isinstance(self.content, str) else text


def values(node: Node) -> Plain:
    """The node as Python's own texts, numbers, lists and dicts, new ones at every call."""
    if isinstance(node.content, dict):
        return {key: values(member) for key, member in node.content.items()}
    return [values(item) for item in node.content] if isinstance(node.content, list) else node.content


class _Refusal(Exception):
    def __init__(self, expected: str, line: int | None = None, value: str = "", key: str = "") -> None:
        super().__init__(expected)
        self.problem = Problem(key, value, expected, line)


def resolve_scalar(text: str, is_plain: bool) -> Scalar:
    """The value of a scalar by YAML 1.2's core schema; quoted scalars are texts."""
    if not is_plain:
        return text
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in ("true", "True", "TRUE"):
        return True
    if text in ("false", "False", "FALSE"):
        return False
    if _INTEGER.fullmatch(text) and len(text) <= _MAX_DIGITS:
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _SPECIAL.fullmatch(text):
        return float(text.replace(".", "").lower())
    return text


class _Builder:
    """Turns the parser's events into nodes, without recursion into the yaml library's own constructors."""

    def __init__(self, text: str, loader: type) -> None:
        self._events: Iterator[yaml.Event] = yaml.parse(text, Loader=loader)

    def document(self) -> Node | None:
        """The only document, None for an empty file."""
        root: Node | None = None
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                if root is not None:
                    raise _Refusal("expected one document only, without a second `---`", _line(event))
                root = self._node(next(self._events), "", 0)
        return root

    def _node(self, event: yaml.Event, key: str, depth: int) -> Node:
        line = _line(event)
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise _Refusal("anchors and aliases (& and *) are not allowed: write the value out", line, key=key)
        if depth > MAX_DEPTH:
            raise _Refusal(f"nested deeper than {MAX_DEPTH} levels", line, key=key)
        if getattr(event, "tag", None) not in (None, "!"):
            raise _Refusal("tags (!) are not allowed", line, key=key)
        if isinstance(event, yaml.ScalarEvent):
            return Node(resolve_scalar(event.value, not event.style), key, line, event.value)
        if isinstance(event, yaml.SequenceStartEvent):
            return Node(list(self._items(key, depth)), key, line)
        if isinstance(event, yaml.MappingStartEvent):
            return Node(self._mapping(key, depth), key, line)
        raise _Refusal("not understood", line, key=key)

    def _items(self, key: str, depth: int) -> Iterator[Node]:
        for index, event in enumerate(self._events):
            if isinstance(event, yaml.SequenceEndEvent):
                return
            yield self._node(event, f"{key}[{index}]", depth + 1)

    def _mapping(self, key: str, depth: int) -> dict[str, Node]:
        members: dict[str, Node] = {}
        for event in self._events:
            if isinstance(event, yaml.MappingEndEvent):
                break
            if not isinstance(event, yaml.ScalarEvent):
                raise _Refusal("expected a plain word as key", _line(event), key=key)
            name = event.value
            path = f"{key}.{name}" if key else name
            if name in members:
                raise _Refusal(
                    f"this key stands here twice, first in line {members[name].line}", _line(event), key=path
                )
            members[name] = self._node(next(self._events), path, depth + 1)
        return members


def _line(event: yaml.Event) -> int:
    mark = event.start_mark
    return 1 if mark is None else int(mark.line) + 1


def read_bytes(path: Path) -> bytes:
    """The file's bytes; DocumentError when it cannot be read or is larger than MAX_BYTES (it is then not read)."""
    try:
        if not path.is_file():
            reason = (
                "is a folder, not a file" if path.is_dir() else "is not a file" if path.exists() else "no such file"
            )
            raise DocumentError(str(path), [Problem("", "", reason)])
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise DocumentError(str(path), [Problem("", f"{size} bytes", f"expected at most {MAX_BYTES} bytes")])
        with path.open("rb") as file:
            return file.read(MAX_BYTES + 1)
    except OSError as error:
        raise DocumentError(str(path), [Problem("", "", f"cannot be read: {error.strerror}")]) from error


@lru_cache(maxsize=4)
def _document(text: str) -> Node | None:
    """Of a text that is read again and again: by who wrote it, and by who checks it. The compiled parser takes a tenth
    of the time of PyYAML's own, which words what is wrong with a text and refuses tabs between its parts.
    """
    if _COMPILED is not None and "\t" not in text:
        with suppress(yaml.YAMLError, _Refusal):
            return _Builder(text, _COMPILED).document()
    return _Builder(text, yaml.SafeLoader).document()


def parse_mapping(data: bytes, path: str) -> Node:
    """The top mapping of a YAML file, not to be changed. Raises DocumentError with one problem."""
    try:
        root = _document(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise DocumentError(path, [Problem("", f"byte {error.start}", "is not UTF-8 text")]) from None
    except _Refusal as refusal:
        raise DocumentError(path, [refusal.problem]) from None
    except yaml.YAMLError as error:
        raise DocumentError(path, [_yaml_problem(error, data.decode("utf-8"))]) from None
    if root is None or root.content is None:
        raise DocumentError(path, [Problem("", "", "is empty")])
    if not isinstance(root.content, dict):
        raise DocumentError(path, [Problem("", root.shown(), "expected a mapping of keys to values", root.line)])
    return root


def _yaml_problem(error: yaml.YAMLError, text: str) -> Problem:
    mark, context = getattr(error, "problem_mark", None), getattr(error, "context_mark", None)
    line = None if mark is None else int(mark.line) + 1
    what = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
    if line is not None:
        first = line if context is None else int(context.line) + 1
        what = "; ".join(filter(None, (what, pasted_sign("".join(text.splitlines()[first - 1 : line])))))
    return Problem("", "", f"is not YAML: {what}", line)
