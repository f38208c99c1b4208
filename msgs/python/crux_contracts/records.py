"""Files that people write by hand, as dataclasses whose fields say what each key may hold: one reader for all of them.

Of the same fields msgs/generate makes the JSON schemas by which editors complete and check such files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar, get_args, get_type_hints

from .reading import Checker
from .yaml_document import Node

T = TypeVar("T")
REQUIRED = MISSING


@dataclass(frozen=True)
class Key:
    """Numbers lie in low..high, greater than `low` where `above`; a list has at most `most` entries. `words` are to
    choose from, or a mapping's keys; `reader` is the method that reads a key where its type does not say how."""

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    means: str = ""
    above: bool = False
    words: Sequence[str] = ()
    most: int = 0
    reader: str = ""
    required: bool = False
    type: Any = None
    default: Any = None


def key(default: Any, *bounds: Any, **more: Any) -> Any:
    """A dataclass's field that is a key of a file, with what Key says; `dict` as default is an empty one."""
    described: Any = {"metadata": {"key": Key(*bounds, **{"required": default is REQUIRED} | more)}}
    return field(default_factory=dict, **described) if default is dict else field(default=default, **described)


@cache
def keys_of(kind: Any) -> dict[str, Key]:
    """The keys of a dataclass by name."""
    hints = get_type_hints(kind)
    found = [each for each in fields(kind) if "key" in each.metadata]
    return {each.name: replace(each.metadata["key"], type=hints[each.name], default=each.default) for each in found}


class Records:
    """Reads them, noting every problem on the way."""

    def __init__(self, path: str) -> None:
        self.check = Checker(path)

    def record(self, kind: type[T], *nodes: Node, place: str = "") -> T:
        """A dataclass, each key from the last of the mappings that has it; what is missing has been noted."""
        keys = keys_of(kind)  # type: ignore[arg-type]
        missing = dict.fromkeys(name for name, key in keys.items() if key.required)
        return kind(**missing | self.keys(keys, *nodes, place=place))

    def keys(self, keys: Mapping[str, Key], *nodes: Node, place: str = "") -> dict[str, Any]:
        """What the keys hold that are there, each from the last of the mappings that has it."""
        required = [name for name, key in keys.items() if key.required]
        members: dict[str, Node] = {}
        for node in nodes:
            members |= self.check.members(node, required, [name for name in keys if name not in required])
        return {name: self.value(keys[name], members[name], f"{place}.{name}") for name in keys if name in members}

    def value(self, key: Key, node: Node, place: str = "") -> Any:
        """What a key holds, by its type."""
        parts = [part for part in get_args(key.type) if part is not type(None)]
        if key.reader:
            return getattr(self, key.reader)(node)
        if type(None) in get_args(key.type):
            return self.value(replace(key, type=parts[0]), node, place)
        if key.type is float:
            return self.number(node, key, place)
        if key.type is int:
            return self.check.integer(node, int(key.low), int(key.high))
        if key.type is bool:
            return self.check.flag(node)
        if is_dataclass(key.type):
            return self.record(key.type, node, place=place)  # type: ignore[arg-type]
        if key.type is str:
            return self.check.choice(node, key.words) if key.words else self.check.text(node)
        if key.type.__origin__ is dict:
            return self.mapping(key, node, place=place)
        if is_dataclass(parts[0]):
            return tuple(self.record(parts[0], item) for item in self.check.items(node, key.most))  # type: ignore[arg-type]
        return self.vector(node, key, len(key.default) if parts[-1] is ... else len(parts), place)

    def mapping(self, key: Key, node: Node, required: Sequence[str] = (), place: str = "") -> dict[str, Any]:
        """Values by the key's words."""
        members = self.check.members(node, required, [word for word in key.words if word not in required])
        each = replace(key, type=get_args(key.type)[1], words=())
        return {word: self.value(each, members[word], f"{place}.{word}") for word in key.words if word in members}

    def number(self, node: Node, bounds: Key, place: str) -> float:  # noqa: ARG002
        """A number; `place` is its way in the file."""
        return self.check.number(node, bounds.low, bounds.high, bounds.unit, bounds.above)

    def vector(self, node: Node, bounds: Key, count: int, place: str) -> tuple[float, ...]:  # noqa: ARG002
        """So many numbers."""
        return self.check.numbers(node, count, bounds.low, bounds.high, bounds.unit)
