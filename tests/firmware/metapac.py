"""Register descriptions of the STM32G474 from the crate stm32-metapac (made from ST's own files by the embassy
project), and of the Cortex-M core from the crate cortex-m. Both are pinned by metapac/Cargo.lock; cargo fetches them
once."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

MANIFEST = Path(__file__).resolve().parent / "metapac" / "Cargo.toml"
CHIP = "stm32g474re"
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[A-Za-z_][\w:]*|0x[0-9a-fA-F_]+|\d[\d_]*|\.\.=|[{}()\[\],:&]')


@cache
def crate(name: str) -> Path:
    """Folder of a locked crate's sources."""
    cargo = shutil.which("cargo", path=f"{os.environ['PATH']}:{Path.home()}/.cargo/bin")
    assert cargo is not None, "no cargo: run `make setup`"
    command = [cargo, "metadata", "--locked", "--format-version", "1", "--manifest-path", str(MANIFEST)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, f"cargo does not give {name}: {run.stderr}"
    packages = json.loads(run.stdout)["packages"]
    return next(Path(p["manifest_path"]).parent for p in packages if p["name"] == name)


def _literal(tokens: list[str], at: int) -> tuple[Any, int]:
    """A Rust literal from tokens[at]: structures become dictionaries, Some(x) x, None None, a path its last name."""
    token = tokens[at]
    if token == "&":
        return _literal(tokens, at + 1)
    if token == "[":
        items = []
        at += 1
        while tokens[at] != "]":
            item, at = _literal(tokens, at)
            items.append(item)
            at += tokens[at] == ","
        return items, at + 1
    if token[0] == '"':
        return token[1:-1], at + 1
    if token[0].isdigit():
        if tokens[at + 1] == "..=":
            return range(int(token), int(tokens[at + 2]) + 1), at + 3
        return int(token.replace("_", ""), 0), at + 1
    if tokens[at + 1] == "(":
        value, at = _literal(tokens, at + 2)
        at += tokens[at] == ","
        return value, at + 1
    if tokens[at + 1] == "{":
        members: dict[str, Any] = {}
        at += 2
        while tokens[at] != "}":
            name = tokens[at].rstrip(":")
            members[name], at = _literal(tokens, at + (1 if tokens[at].endswith(":") else 2))
            at += tokens[at] == ","
        return members, at + 1
    return (None if token == "None" else token.rsplit("::", 1)[-1]), at + 1


def _static(text: str, name: str) -> Any:
    """Value of `static NAME: TYPE = LITERAL;`"""
    start = re.search(rf"static {name}\b[^=]*=", text)
    assert start is not None, f"no {name}"
    return _literal(_TOKEN.findall(text, start.end()), 0)[0]


@dataclass(frozen=True)
class Field:
    bits: tuple[int, ...]
    """Places in the word, lowest first."""
    variants: dict[str, int]

    def word(self, value: int) -> int:
        """The field's value in its place."""
        assert value >> len(self.bits) == 0
        return sum(1 << bit for number, bit in enumerate(self.bits) if value >> number & 1)

    @property
    def mask(self) -> int:
        return sum(1 << bit for bit in self.bits)


@dataclass(frozen=True)
class Register:
    address: int
    bits: int
    fields: dict[str, Field]


@cache
def _chip() -> str:
    folder = crate("stm32-metapac") / "src" / "chips"
    own = (folder / CHIP / "metadata.rs").read_text(encoding="utf-8")
    included = re.search(r'include!\("\.\./(\w+\.rs)"\)', own)
    assert included is not None
    return (folder / included.group(1)).read_text(encoding="utf-8")


@cache
def peripherals() -> dict[str, dict[str, Any]]:
    """Address, registers' description and pins by name."""
    return {entry["name"]: entry for entry in _static(_chip(), "PERIPHERALS")}


@cache
def interrupts() -> dict[str, int]:
    return {entry["name"]: entry["number"] for entry in _static(_chip(), "INTERRUPTS")}


@cache
def _description(kind: str, version: str) -> dict[str, dict[str, Any]]:
    text = (crate("stm32-metapac") / "src" / "registers" / f"{kind}_{version}.rs").read_text(encoding="utf-8")
    ir = _static(text, "REGISTERS")
    return {part: {_plain(entry["name"]): entry for entry in ir[part]} for part in ("blocks", "fieldsets", "enums")}


def _plain(name: str) -> str:
    """The crate writes one name as ABC_DEF and as AbcDef."""
    return name.replace("_", "").lower()


def _with_bases(entries: dict[str, Any], name: str | None, part: str) -> list[dict[str, Any]]:
    """Items of an entry and of all that it extends."""
    items: list[dict[str, Any]] = []
    while name is not None:
        entry = entries[_plain(name)]
        items += entry[part]
        name = entry["extends"]
    return items


def _places(item: dict[str, Any]) -> list[int]:
    """Offsets of an item's elements from its first."""
    array = item["array"]
    if array is None:
        return [0]
    return list(array["offsets"]) if "offsets" in array else [n * array["stride"] for n in range(array["len"])]


def _fields(ir: dict[str, dict[str, Any]], fieldset: str | None) -> dict[str, Field]:
    fields: dict[str, Field] = {}
    for item in _with_bases(ir["fieldsets"], fieldset, "fields"):
        offset, size = item["bit_offset"], item["bit_size"]
        scattered = (bit for piece in offset.get("ranges", ()) for bit in piece)
        bits = tuple(range(offset["offset"], offset["offset"] + size) if "offset" in offset else scattered)
        enum = ir["enums"][_plain(item["enumm"])] if item["enumm"] is not None else {"variants": []}
        variants = {variant["name"].lower(): variant["value"] for variant in enum["variants"]}
        places = _places(item)
        for number, place in enumerate(places):
            name = item["name"] if item["array"] is None else f"{item['name']}[{number}]"
            fields.setdefault(name, Field(tuple(bit + place for bit in bits), variants))
    return fields


@cache
def registers(peripheral: str) -> dict[str, Register]:
    """Registers of a peripheral by name, those of an array as name[n]."""
    entry = peripherals()[peripheral]
    about = entry["registers"]
    ir = _description(about["kind"], about["version"])
    found: dict[str, Register] = {}
    for item in _with_bases(ir["blocks"], about["block"], "items"):
        for number, place in enumerate(_places(item)):
            name = item["name"] if item["array"] is None else f"{item['name']}[{number}]"
            inner = item["inner"]
            fields = _fields(ir, inner.get("fieldset"))
            address = entry["address"] + item["byte_offset"] + place
            found.setdefault(name, Register(address, inner.get("bit_size", 0), fields))
    return found


@cache
def core(block: str) -> dict[str, int]:
    """Addresses of a core peripheral's registers (first elements of arrays) by name, as on a Cortex-M4."""
    folder = crate("cortex-m") / "src" / "peripheral"
    base = re.search(rf"PTR: \*const (?:self::)?{block}::RegisterBlock = (0x\w+)", (folder / "mod.rs").read_text())
    assert base is not None
    address = int(base.group(1).replace("_", ""), 0)
    text = (folder / f"{block}.rs").read_text(encoding="utf-8")
    body = text[text.index("pub struct RegisterBlock {") :].split("\n}", 1)[0]
    found = {}
    attributes: list[str] = []
    for line in map(str.strip, body.splitlines()):
        if line.startswith("#[cfg("):
            attributes.append(line)
        entry = re.match(r"(?:pub(?:\([^)]*\))? )?(\w+): (\[)?(?:\w\w<)?u(8|16|32)>?(?:; ([\w:]+))?", line)
        if entry is None:
            continue
        name, _, bits, count = entry.groups()
        here = all(("armv6m" not in a and "armv8m" not in a) == ("not(" not in a) or "has_fpu" in a for a in attributes)
        attributes = []
        if here:
            found[name] = address
            address += int(bits) // 8 * (16 if count and not count.isdigit() else int(count or 1))
    return found
