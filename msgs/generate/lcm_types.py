"""Parser of the subset of LCM's type language that crux uses."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

INTEGERS = {"int8_t": 1, "int16_t": 2, "int32_t": 4, "int64_t": 8}
PRIMITIVES = {**INTEGERS, "double": 8, "float": 4, "byte": 1, "string": 0}

_TOKEN = re.compile(r"\s+|//[^\n]*|/\*.*?\*/|([A-Za-z_][\w.]*|-?\d+(?:\.\d+)?|[{}\[\];,=])", re.DOTALL)


class LcmSyntaxError(Exception):
    """A .lcm file that this parser does not understand."""


@dataclass(frozen=True)
class Field:
    """One member. `dimension` is None for a scalar, an int for a fixed array, a member's name for a sequence."""

    name: str
    type: str
    dimension: int | str | None = None

    @property
    def is_primitive(self) -> bool:
        return self.type in PRIMITIVES


@dataclass(frozen=True)
class Constant:
    name: str
    type: str
    value: int


@dataclass
class Struct:
    package: str
    name: str
    constants: list[Constant] = field(default_factory=list)
    enumerations: list[tuple[str, ...]] = field(default_factory=list)  # constants of a line that count from 0
    fields: list[Field] = field(default_factory=list)

    @property
    def ros_name(self) -> str:
        """limb_knot_t -> LimbKnot."""
        return "".join(part.capitalize() for part in self.name.removesuffix("_t").split("_"))

    @property
    def schema_name(self) -> str:
        return f"{self.package}/msg/{self.ros_name}"


class _Tokens:
    def __init__(self, path: Path) -> None:
        text = path.read_text(encoding="utf-8")
        self._path = path
        self._items: list[tuple[str, int]] = []
        position = 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None:
                line = text.count("\n", 0, position) + 1
                raise LcmSyntaxError(f"{path}:{line}: unexpected character {text[position]!r}")
            if match.group(1):
                self._items.append((match.group(1), text.count("\n", 0, position) + 1))
            position = match.end()
        self._next = 0

    def done(self) -> bool:
        return self._next >= len(self._items)

    def take(self, expected: str | None = None) -> str:
        token, line = self._items[self._next] if not self.done() else ("end of file", 0)
        if expected is not None and token != expected:
            raise LcmSyntaxError(f"{self._path}:{line}: expected {expected!r}, found {token!r}")
        self._next += 1
        return token

    def take_if(self, wanted: str) -> bool:
        if not self.done() and self._items[self._next][0] == wanted:
            self._next += 1
            return True
        return False


def _local_name(type_name: str, package: str) -> str:
    return type_name.removeprefix(f"{package}.")


def _parse_constants(tokens: _Tokens, struct: Struct) -> None:
    type_name = tokens.take()
    if type_name not in INTEGERS:
        raise LcmSyntaxError(f"{struct.name}: constants must be integers, not {type_name}")
    constants = []
    while True:
        name = tokens.take()
        tokens.take("=")
        constants.append(Constant(name, type_name, int(tokens.take())))
        if not tokens.take_if(","):
            break
    tokens.take(";")
    struct.constants += constants
    if [constant.value for constant in constants] == list(range(len(constants))):
        struct.enumerations.append(tuple(constant.name for constant in constants))


def _parse_fields(tokens: _Tokens, struct: Struct) -> None:
    type_name = _local_name(tokens.take(), struct.package)
    while True:
        name = tokens.take()
        dimension: int | str | None = None
        if tokens.take_if("["):
            size = tokens.take()
            dimension = int(size) if size.isdigit() else size
            tokens.take("]")
        struct.fields.append(Field(name, type_name, dimension))
        if not tokens.take_if(","):
            break
    tokens.take(";")


def parse_file(path: Path) -> list[Struct]:
    """All structs of one .lcm file, in the order of the file."""
    tokens = _Tokens(path)
    package = ""
    structs = []
    while not tokens.done():
        keyword = tokens.take()
        if keyword == "package":
            package = tokens.take()
            tokens.take(";")
            continue
        if keyword != "struct":
            raise LcmSyntaxError(f"{path}: expected 'package' or 'struct', found {keyword!r}")
        struct = Struct(package, tokens.take())
        tokens.take("{")
        while not tokens.take_if("}"):
            if tokens.take_if("const"):
                _parse_constants(tokens, struct)
            else:
                _parse_fields(tokens, struct)
        structs.append(struct)
    return structs


def parse_files(paths: list[Path]) -> dict[str, Struct]:
    """Structs of all files by name, each type after the types it contains.

    Raises LcmSyntaxError for an unknown type, a sequence without its length member, or a type that contains itself.
    """
    found = {struct.name: struct for path in sorted(paths) for struct in parse_file(path)}
    ordered: dict[str, Struct] = {}

    def visit(name: str, chain: tuple[str, ...]) -> None:
        if name in ordered:
            return
        if name in chain:
            raise LcmSyntaxError(f"{name} contains itself: {' -> '.join(chain)}")
        if name not in found:
            raise LcmSyntaxError(f"{chain[-1]}: unknown type {name}")
        seen: set[str] = set()
        for member in found[name].fields:
            if isinstance(member.dimension, str) and member.dimension not in seen:
                raise LcmSyntaxError(f"{name}.{member.name}: length {member.dimension} must be a member before it")
            if not member.is_primitive:
                visit(member.type, (*chain, name))
            seen.add(member.name)
        ordered[name] = found[name]

    for name in found:
        visit(name, ())
    return ordered
