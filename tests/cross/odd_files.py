"""Changes of good files: of bytes, of words, of values in a tree, of what an MCAP file holds under right checksums."""

from __future__ import annotations

import copy
import json
import re
import struct
from io import BytesIO
from typing import Any

import yaml
from crux_contracts import plan_file
from crux_msgs import plan_t
from crux_msgs.tables import MEMBERS
from crux_planner.checker.certificate import digest
from hypothesis import strategies as st
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

Draw = st.DataObject
WORDS = (
    "", "-1", "0", "1e400", "1e-320", ".nan", ".inf", "nan", "null", "true", "~", "[]", "{}", "[1, 2]", "[[[]]]", "''",
    "'text'", "\u22121", "\u2212x", "\u00a0", "\ufeff", "é", "\u202e", "x", "x" * 3000, "99999999999999999999", "0x10",
    "2026-11-22", "../..", "/", "%s", "{0}", "\x00", "&a", "*a", "!!python/none", "# ", ": ", "- ", "\t", "\n", "<",
    ">", "\ud7ff", "9" * 5000,
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 2**31, 2**63, 10**400, 0.5, -1e9, 1e308, float("inf"), float("nan"), "", "x", "1", "+x",
    "no plan", [], {}, [[]], [1, 2], ["x"] * 6, [1.0] * 6, {"x": 1}, [None] * 6, [{}], "\u2212", "\x00", "\ud800",
)  # fmt: skip
NUMBERS = (0.0, -1.0, 1.0, 1e-320, 1e9, -1e9, 1e308, 0.3)
WHOLE = (0, 1, -1, 2, 3, 4, 5, 7, 100, -(2**31), 2**31 - 1)
_TOKEN = re.compile(r"[\w.+-]+|[^\w\s]|\n *")


def other_bytes(data: bytes, draw: Draw) -> bytes:
    """Some bytes put in, taken out or in others' place; or the end cut off."""
    changed = bytearray(data)
    if draw.draw(st.integers(0, 4)) == 0:
        return bytes(changed[: draw.draw(st.integers(0, len(changed)))])
    for _ in range(draw.draw(st.integers(1, 4))):
        start = draw.draw(st.integers(0, len(changed)))
        changed[start : start + draw.draw(st.integers(0, 6))] = draw.draw(st.binary(max_size=6))
    return bytes(changed)


def other_words(data: bytes, draw: Draw) -> bytes:
    """Words, signs and line ends of a text in others' place; or a line left out, or twice."""
    text = data.decode("utf-8", "replace")
    text = text if _TOKEN.search(text) else "x"
    for _ in range(draw.draw(st.integers(1, 3))):
        if draw.draw(st.booleans()):
            tokens = list(_TOKEN.finditer(text))
            token = tokens[draw.draw(st.integers(0, len(tokens) - 1))]
            text = text[: token.start()] + draw.draw(st.sampled_from(WORDS)) + text[token.end() :]
            if not _TOKEN.search(text):
                break
            continue
        lines = text.splitlines(keepends=True)
        at = draw.draw(st.integers(0, len(lines) - 1))
        lines[at : at + 1] = draw.draw(st.sampled_from(([], [lines[at]] * 2, ["  " + lines[at]])))
        text = "".join(lines) or "\n"
        if not _TOKEN.search(text):
            break
    return text.encode("utf-8", "surrogatepass")


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(found for key, child in children for found in _paths(child, (*path, key)))]


def other_tree(tree: Any, draw: Draw) -> Any:
    """Values of a tree of mappings and lists left out, renamed or replaced."""
    tree = copy.deepcopy(tree)
    for _ in range(draw.draw(st.integers(1, 3))):
        paths = _paths(tree)[1:]
        if not paths:
            break
        *way, last = paths[draw.draw(st.integers(0, len(paths) - 1))]
        parent = tree
        for step in way:
            parent = parent[step]
        action = draw.draw(st.sampled_from(("delete", "replace", "replace", "rename")))
        if action == "delete":
            del parent[last]
        elif action == "rename" and isinstance(parent, dict):
            parent[draw.draw(st.text(max_size=6))] = parent.pop(last)
        else:
            parent[last] = copy.deepcopy(draw.draw(st.sampled_from(VALUES)))
    return tree


def other_yaml(data: bytes, draw: Draw) -> bytes:
    """A YAML file with other values."""
    tree = other_tree(yaml.safe_load(data), draw)
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True).encode("utf-8", "surrogatepass")


def other_json(data: bytes, draw: Draw) -> bytes:
    """A JSON file with other values."""
    return json.dumps(other_tree(json.loads(data), draw)).encode()


def other_certificate(data: bytes, draw: Draw) -> bytes:
    """A certificate with other values, sealed again."""
    tree = other_tree(json.loads(data), draw)
    return json.dumps({**tree, "sha256": digest(tree)}).encode()


def _other_message(message: Any, type_name: str, draw: Draw) -> None:
    member, kind, dimension = draw.draw(st.sampled_from(MEMBERS[type_name]))
    value = getattr(message, member)
    if kind in MEMBERS:
        each = value if dimension is None else draw.draw(st.sampled_from(value)) if value else None
        if each is not None:
            _other_message(each, kind, draw)
        return
    if kind == "string":
        text = other_words(value.encode() or b"x", draw).decode("utf-8", "replace")
        setattr(message, member, draw.draw(st.sampled_from((text, "", "x"))))
        return
    new = draw.draw(
        st.sampled_from(NUMBERS if kind in ("double", "float") else WHOLE[:7] if kind == "int8_t" else WHOLE)
    )
    if dimension is None:
        setattr(message, member, new)
    elif len(value):
        values = list(value)
        values[draw.draw(st.integers(0, len(values) - 1))] = new
        setattr(message, member, values)


def other_plan(data: bytes, draw: Draw) -> bytes:
    """A plan with other values in a sound file, its plan_id right again."""
    plan = plan_file.from_bytes(data)
    assert isinstance(plan, plan_t)
    for _ in range(draw.draw(st.integers(1, 3))):
        _other_message(plan, "plan_t", draw)
    plan.n_knots, plan.n_holds = len(plan.knots), len(plan.holds)
    check, plan_file._check = plan_file._check, lambda *_: None
    try:
        return plan_file.to_bytes(plan)
    except (plan_file.PlanFileError, struct.error, OverflowError):  # no file can have it
        return data
    finally:
        plan_file._check = check


def _other_record(record: Any, draw: Draw) -> None:
    if isinstance(record, Message):
        record.data = other_bytes(record.data, draw)
        if draw.draw(st.integers(0, 3)) == 0:
            record.log_time = draw.draw(st.sampled_from((0, 1, 10**9, 2**62, 2**63, 2**64 - 1)))
    elif isinstance(record, Schema):
        change = draw.draw(st.sampled_from((other_words, other_bytes)))
        record.data = change(record.data, draw)
    elif isinstance(record, Channel):
        name = draw.draw(st.sampled_from(("topic", "message_encoding")))
        setattr(
            record,
            name,
            draw.draw(st.sampled_from(("", "/x", "/plan", "/fault", "/robot_state", "cdr", "/truth/verdict"))),
        )
    elif isinstance(record, Metadata):
        key = draw.draw(st.sampled_from(sorted(record.metadata) or ["x"]))
        record.metadata[key] = draw.draw(st.sampled_from(WORDS))
    elif isinstance(record, Attachment):
        change = draw.draw(st.sampled_from((other_words, other_bytes)))
        record.data = change(record.data, draw)
        record.name = draw.draw(st.sampled_from((record.name,) * 4 + ("x", "../x", "", "robot.yaml", "/", "\x00")))


def other_log(data: bytes, draw: Draw) -> bytes:
    """A log with other records in a sound file; kinds of records that are few are as likely as those that are many."""
    records = list(StreamReader(BytesIO(data)).records)
    for _ in range(draw.draw(st.integers(1, 3))):
        kind = draw.draw(st.sampled_from((Message, Message, Schema, Channel, Metadata, Attachment)))
        of_kind: list[Any] = [record for record in records if isinstance(record, kind)]
        if kind is Message:  # of any channel, as likely
            channels = sorted({record.channel_id for record in of_kind})
            channel = draw.draw(st.sampled_from(channels))
            of_kind = [record for record in of_kind if record.channel_id == channel]
        _other_record(draw.draw(st.sampled_from(of_kind)), draw)
    return written(records)


def written(records: list[Any]) -> bytes:
    """An MCAP file of the records."""
    out = BytesIO()
    writer = Writer(out, compression=CompressionType.LZ4)
    writer.start(profile="ros2", library="odd")
    schemas, channels = {}, {}
    for record in records:
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas[record.schema_id]
            channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schema)
        elif isinstance(record, Message):
            writer.add_message(
                channels[record.channel_id], record.log_time, record.data, record.log_time, record.sequence
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
