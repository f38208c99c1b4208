"""Python beside lcm-gen's own output: type stubs and the tables as data."""

from __future__ import annotations

from .lcm_types import INTEGERS, Field, Struct
from .ros2msg import definition
from .tables import Channel, Fault


def _python_type(member: Field) -> str:
    if member.type == "byte":
        return "int" if member.dimension is None else "bytes"
    if member.type in INTEGERS:
        base = "int"
    else:
        base = {"double": "float", "float": "float", "string": "str"}.get(member.type, member.type)
    if member.dimension is None:
        return base
    return f"Sequence[{base}]" if member.is_primitive else f"list[{base}]"


def stub(structs: dict[str, Struct]) -> str:
    """__init__.pyi of the package crux_msgs."""
    classes = []
    for struct in structs.values():
        lines = [f"    {c.name}: ClassVar[int]" for c in struct.constants]
        lines += [f"    {f.name}: {_python_type(f)}" for f in struct.fields]
        classes.append(
            f"class {struct.name}:\n" + "\n".join(lines) + "\n"
            "    def __init__(self) -> None: ...\n"
            "    def encode(self) -> bytes: ...\n"
            "    @staticmethod\n"
            f"    def decode(data: bytes) -> {struct.name}: ...\n"
            "    def get_hash(self) -> int: ...\n"
        )
    return "from collections.abc import Sequence\nfrom typing import ClassVar\n\n" + "\n".join(classes)


def tables_module(structs: dict[str, Struct], channels: list[Channel], faults: list[Fault], log_format: int) -> str:
    """crux_msgs/tables.py: plain data, wrapped with types by crux_contracts.channels."""
    members = {s.name: [(f.name, f.type, f.dimension) for f in s.fields] for s in structs.values()}
    schemas = {s.name: (s.schema_name, definition(s, structs)) for s in structs.values()}
    enumerations = {s.name: s.enumerations for s in structs.values() if s.enumerations}
    rows = [(c.name, c.type, c.rate_Hz, c.writer, c.logged, c.topic, c.per_limb) for c in channels]
    fault_rows = [(f.code, f.name, f.to, f.text) for f in faults]
    help_rows = {f.code: (f.cause, f.do) for f in faults}

    def listing(name: str, annotation: str, items: list[str], brackets: str) -> str:
        body = "\n".join(f"    {item}," for item in items)
        return f"{name}: {annotation} = {brackets[0]}\n{body}\n{brackets[1]}\n"

    return "\n".join(
        [
            '"""Generated from msgs/ by msgs/generate. Do not edit."""\n',
            f"LOG_FORMAT: int = {log_format}\n",
            "# type -> (schema name, ros2msg definition)",
            listing("SCHEMAS", "dict[str, tuple[str, str]]", [f"{k!r}: {v!r}" for k, v in schemas.items()], "{}"),
            "# type -> [(member, LCM type, None | fixed length | name of the length member)]",
            listing(
                "MEMBERS",
                "dict[str, list[tuple[str, str, int | str | None]]]",
                [f"{k!r}: {v!r}" for k, v in members.items()],
                "{}",
            ),
            "# type -> [names of constants that count 0, 1, 2 ...]",
            listing(
                "ENUMERATIONS",
                "dict[str, list[tuple[str, ...]]]",
                [f"{k!r}: {v!r}" for k, v in enumerations.items()],
                "{}",
            ),
            "# (name, type, rate_Hz, writer, logged, topic, per_limb); rate -1: when something happens, 0: only logged",
            listing("CHANNELS", "list[tuple[str, str, float, str, bool, str, bool]]", [repr(r) for r in rows], "[]"),
            "# (code, name, supervisor state that follows, text)",
            listing("FAULTS", "list[tuple[int, str, str, str]]", [repr(r) for r in fault_rows], "[]"),
            "# code -> (cause, what to do)",
            listing("FAULT_HELP", "dict[int, tuple[str, str]]", [f"{k!r}: {v!r}" for k, v in help_rows.items()], "{}"),
        ]
    )


def channel_names_module(channels: list[Channel]) -> str:
    """crux_msgs/channel_names.py: CRUX_PLAN = "CRUX_PLAN" and so on."""
    names = "\n".join(f'{c.name} = "{c.name}"' for c in channels)
    return f'"""Generated from msgs/channels.yaml by msgs/generate. Do not edit."""\n\n{names}\n'
