"""Changes values in a YAML text and leaves all else in it as it is: comments, order, and how values are written."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import yaml
from crux_contracts.yaml_document import DocumentError, parse_mapping, resolve_scalar, values

DIGITS = 6  # of numbers that are written
_PLAIN = re.compile(r"[+A-Za-z_-][\w+-]*(?: [\w+-]+)*")
Kept = Mapping[str, Sequence[int | None]]


class _CannotSplice(Exception):
    pass


def rewritten(text: str, wanted: Mapping[str, Any], kept: Kept) -> str | None:
    """`text`, a mapping that `parse_mapping` reads, with the values `wanted`. `kept` says, by the key of a list of the
    top mapping, which item of the old list each of the new ones is, in the same order; None: it is a new one.

    None where no such change of the text is found: then it has to be written anew, without its comments.
    """
    text = text if text.endswith("\n") else f"{text}\n"
    old = values(parse_mapping(text.encode(), "file"))
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    splice = _Splice(text, kept)
    assert root is not None
    try:
        splice.members(root, old, wanted, top=True)
        new = splice.done()
        return new if _is_same(values(parse_mapping(new.encode(), "file")), wanted) else None
    except (_CannotSplice, DocumentError):
        return None


def _is_same(a: Any, b: Any) -> bool:
    """But for the digits that are not written."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_is_same(each, b[key]) for key, each in a.items())
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_is_same, a, b))
    numbers = [isinstance(each, int | float) and not isinstance(each, bool) for each in (a, b)]
    return bool(math.isclose(a, b, rel_tol=1e-9, abs_tol=10.0**-DIGITS) if all(numbers) else a == b)


def written(content: Mapping[str, Any]) -> str:
    """The content as a new YAML text."""
    return "".join(_lines(key, value, 0) for key, value in content.items())


def inline(value: Any) -> str:
    """A value in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{inline(key)}: {inline(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(inline, value)) + "]"
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and isinstance(resolve_scalar(value, True), str)
        return value if plain else json.dumps(value, ensure_ascii=False)
    if isinstance(value, float):
        return f"{value:.{DIGITS}f}".rstrip("0").removesuffix(".") if abs(value) < 1e9 else repr(value)
    return json.dumps(value)


def _lines(key: str, value: Any, indent: int) -> str:
    """A key and its value as lines, nested where that is easier to read."""
    head, more = f"{' ' * indent}{inline(key)}:", " " * (indent + 2)
    if isinstance(value, Mapping) and any(isinstance(each, Mapping) for each in value.values()):
        return f"{head}\n" + "".join(_lines(name, each, indent + 2) for name, each in value.items())
    if isinstance(value, list | tuple) and any(isinstance(each, Mapping) for each in value):
        return f"{head}\n" + "".join(f"{more}- {inline(each)}\n" for each in value)
    return f"{head} {inline(value)}\n"


def _end(node: yaml.Node) -> int:
    """Where a value ends; a block's end mark is where the next one begins."""
    if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(last, tuple) else last)


def _start(node: yaml.Node) -> int:
    return int(node.start_mark.index)


@dataclass
class _Splice:
    text: str
    kept: Kept
    edits: list[tuple[int, int, str]] = field(default_factory=list)

    def done(self) -> str:
        """The text with all edits."""
        text, before = self.text, len(self.text) + 1
        for start, end, new in sorted(self.edits, key=lambda edit: edit[0], reverse=True):
            if end > before:
                raise _CannotSplice
            text, before = text[:start] + new + text[end:], start
        return text

    def _edit(self, start: int, end: int, new: str) -> None:
        same = [i for i, (at, to, _) in enumerate(self.edits) if at == to == start == end]
        if same:  # several that come in at one place, in their order
            new = self.edits.pop(same[0])[2] + new
        self.edits.append((start, end, new))

    def _line_start(self, at: int) -> int:
        return self.text.rfind("\n", 0, at) + 1

    def _next_line(self, at: int) -> int:
        return self.text.index("\n", at) + 1

    def members(self, node: Any, old: Any, wanted: Mapping[str, Any], top: bool = False) -> None:
        """Of a mapping."""
        pairs = {key.value: (key, value) for key, value in node.value}
        for name in [name for name in old if name not in wanted]:
            self._remove_member(node, [key for key, _ in node.value], list(pairs), name, pairs[name][1])
        for name, value in wanted.items():
            if name not in old:
                self._add_member(node, name, value)
            elif old[name] != value:
                self._value(*pairs[name], old[name], value, self.kept.get(name) if top else None)

    def _value(
        self, key: yaml.Node, node: yaml.Node, old: Any, wanted: Any, items: Sequence[int | None] | None
    ) -> None:
        if isinstance(old, dict) and isinstance(wanted, Mapping) and old and wanted:
            self.members(node, old, wanted)
        elif items is not None and isinstance(old, list) and old and any(item is not None for item in items):
            self._items(node, old, wanted, items)
        elif isinstance(old, list) and isinstance(wanted, list | tuple) and len(old) == len(wanted):
            for each, before, after in zip(node.value, old, wanted, strict=True):
                if before != after:
                    self._edit(_start(each), _end(each), inline(after))
        else:
            block = _lines("", wanted, key.start_mark.column).partition(":")[2].removesuffix("\n")
            in_line = "\n" not in self.text[key.end_mark.index : _start(node)]
            self._edit(int(key.end_mark.index) + 1, _end(node), f" {inline(wanted)}" if in_line else block)

    def _items(self, node: Any, old: list[Any], wanted: Sequence[Any], items: Sequence[int | None]) -> None:
        """Of a list of mappings: those that stay, in their order, then new ones."""
        stay = [item for item in items if item is not None]
        if stay != sorted(stay) or None in items[: len(stay)]:
            raise _CannotSplice
        if node.flow_style and len(stay) < len(old):
            self._edit(_start(node), _end(node), inline(list(wanted)))
            return
        for index in set(range(len(old))) - set(stay):
            self._edit(self._line_start(_start(node.value[index])), self._next_line(_end(node.value[index])), "")
        for index, value in zip(stay, wanted, strict=False):
            self.members(node.value[index], old[index], value)
        for value in wanted[len(stay) :]:
            if node.flow_style:
                self._edit(_end(node.value[-1]), _end(node.value[-1]), f", {inline(value)}")
            else:
                at = self._next_line(_end(node.value[-1]))
                self._edit(at, at, f"{' ' * node.start_mark.column}- {inline(value)}\n")

    def _add_member(self, node: Any, name: str, value: Any) -> None:
        if node.flow_style:
            at = _end(node.value[-1][1]) if node.value else _start(node) + 1
            self._edit(at, at, f"{', ' if node.value else ''}{inline(name)}: {inline(value)}")
        else:
            at = self._next_line(_end(node))
            self._edit(at, at, _lines(name, value, node.start_mark.column))

    def _remove_member(self, node: Any, keys: list[yaml.Node], names: list[str], name: str, value: yaml.Node) -> None:
        index = names.index(name)
        if len(names) == 1:
            raise _CannotSplice
        if node.flow_style:
            before = _end(node.value[index - 1][1]) if index else _start(keys[0])
            self._edit(before, _end(value) if index else _start(keys[1]), "")
        elif keys[index].start_mark.column == keys[index].start_mark.index - self._line_start(_start(keys[index])):
            first = self._line_start(_start(keys[index]))
            if self.text[first : _start(keys[index])].strip():  # behind a dash
                raise _CannotSplice
            self._edit(first, self._next_line(_end(value)), "")
