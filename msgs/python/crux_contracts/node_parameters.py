"""The table of the nodes' parameters (msgs/can/parameters.yaml)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from .places import MSGS

TABLE = MSGS / "can" / "parameters.yaml"
NODE_KINDS = ("joint", "gripper")
MOST = 32  # parameters of a node: their numbers on the bus have five bits


class ParameterTableError(ValueError):
    """A table that contradicts itself."""


@dataclass(frozen=True)
class Parameter:
    """One number of a node; `write` is its writable range in shares of the description's value, None: read-only."""

    id: int
    name: str
    unit: str
    kind: str
    means: str
    write: tuple[float, float] | None = None
    acts: str = "start"


def _parameter(entry: Any, where: str) -> Parameter:
    try:
        write = entry.get("write")
        parameter = Parameter(**(entry | {"write": tuple(write) if write is not None else None}))
    except (TypeError, AttributeError) as error:
        raise ParameterTableError(f"{where}: {error}") from None
    if not re.fullmatch(r"[A-Za-z]\w*", parameter.name):
        raise ParameterTableError(f"{where}: {parameter.name!r} is no name")
    if parameter.kind not in ("float", "integer") or parameter.acts not in ("now", "start"):
        raise ParameterTableError(f"{where}: {parameter.name}: kind is float | integer, acts is now | start")
    if not 1 <= parameter.id < MOST:
        raise ParameterTableError(f"{where}: {parameter.name}: id {parameter.id} is not within 1 .. {MOST - 1}")
    if parameter.write is not None and not (len(parameter.write) == 2 and 0 < parameter.write[0] <= parameter.write[1]):
        raise ParameterTableError(
            f"{where}: {parameter.name}: write {parameter.write} is not a range of shares above 0"
        )
    return parameter


def read(path: Path) -> dict[str, tuple[Parameter, ...]]:
    """Parameters of each kind of node, in the order of their structs. Raises ParameterTableError."""
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    if set(document) != set(NODE_KINDS):
        raise ParameterTableError(f"{path}: holds {', '.join(document)}; right is {', '.join(NODE_KINDS)}")
    table = {}
    for kind in NODE_KINDS:
        parameters = tuple(_parameter(entry, f"{path.name}: {kind}") for entry in document[kind])
        for what in ("id", "name"):
            values = [getattr(parameter, what) for parameter in parameters]
            if len(set(values)) != len(values):
                raise ParameterTableError(f"{path.name}: {kind}: the same {what} twice")
        table[kind] = parameters
    return table


@cache
def table() -> dict[str, tuple[Parameter, ...]]:
    """The project's table."""
    return read(TABLE)
