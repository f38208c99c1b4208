"""The golden vectors, read by this project's Python and by decoders that are not ours."""

from __future__ import annotations

import json
import math
from typing import Any

import crux_msgs
import pytest
from crux_contracts import can_codec, cdr
from crux_contracts.channels import SCHEMAS
from crux_msgs.tables import MEMBERS
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from msgs_golden import FOLDER, VECTORS, as_text, message_from
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

MESSAGES: list[dict[str, Any]] = json.loads((FOLDER / "messages.json").read_text(encoding="utf-8"))
FRAMES: list[dict[str, Any]] = json.loads((FOLDER / "can_frames.json").read_text(encoding="utf-8"))


def same(message: Any, type_name: str, fields: dict[str, Any]) -> bool:
    """All fields of a decoded message equal, -0.0 told from 0.0."""

    def equal(kind: str, value: Any, expected: Any) -> bool:
        if kind in MEMBERS:
            return same(value, kind, expected)
        if kind == "double":
            return bool(value == expected) and math.copysign(1, value) == math.copysign(1, expected)
        return bool(value == expected)

    for name, kind, dimension in MEMBERS[type_name]:
        value, expected = getattr(message, name), fields[name]
        if kind == "byte":
            assert bytes(value).hex() == expected, name
        elif dimension is None:
            assert equal(kind, value, expected), name
        else:
            assert len(value) == len(expected), name
            assert all(equal(kind, v, e) for v, e in zip(value, expected, strict=True)), name
    return True


@pytest.mark.parametrize("file_name", VECTORS)
def test_vectors_are_what_this_version_makes(file_name: str) -> None:
    assert (FOLDER / file_name).read_text(encoding="utf-8") == as_text(VECTORS[file_name]())


@pytest.mark.parametrize("vector", MESSAGES, ids=lambda v: v["type"])
def test_messages_decode_from_lcm_and_cdr(vector: dict[str, Any]) -> None:
    type_name, fields = vector["type"], vector["fields"]
    assert same(getattr(crux_msgs, type_name).decode(bytes.fromhex(vector["lcm"])), type_name, fields)
    assert same(cdr.decode(type_name, bytes.fromhex(vector["cdr"])), type_name, fields)


@pytest.mark.parametrize("vector", MESSAGES, ids=lambda v: v["type"])
def test_mcap_ros2_reads_our_cdr(vector: dict[str, Any]) -> None:
    schema = SCHEMAS[vector["type"]]
    decoder = DecoderFactory().decoder_for("cdr", Schema(1, schema.definition.encode(), "ros2msg", schema.name))
    assert decoder is not None
    assert same(decoder(bytes.fromhex(vector["cdr"])), vector["type"], vector["fields"])


@pytest.mark.parametrize("vector", MESSAGES, ids=lambda v: v["type"])
def test_rosbags_reads_our_cdr(vector: dict[str, Any]) -> None:
    schema = SCHEMAS[vector["type"]]
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.definition, schema.name))
    assert same(store.deserialize_cdr(bytes.fromhex(vector["cdr"]), schema.name), vector["type"], vector["fields"])


@pytest.mark.parametrize("places", [100, pytest.param(100_000, marks=pytest.mark.sweep)])
@pytest.mark.parametrize("vector", MESSAGES, ids=lambda v: v["type"])
def test_damaged_cdr_is_refused_or_read_never_more(vector: dict[str, Any], places: int) -> None:
    """Cut off and with another byte at so many places, spread over the whole message."""
    data = bytes.fromhex(vector["cdr"])
    every = -(-len(data) // places)
    for size in (*range(0, len(data), every), len(data) - 1):
        with pytest.raises(cdr.CdrError):
            cdr.decode(vector["type"], data[:size])
    with pytest.raises(cdr.CdrError):
        cdr.decode(vector["type"], data + b"\0")
    for index in range(0, len(data), every):
        for value in (0x00, 0x7F, 0x80, 0xFF):
            damaged = bytearray(data)
            damaged[index] = value
            try:
                cdr.decode(vector["type"], bytes(damaged))
            except cdr.CdrError:
                continue


def test_cdr_refuses_an_array_of_the_wrong_length() -> None:
    message = message_from("hold_t", next(v for v in MESSAGES if v["type"] == "hold_t")["fields"])
    message.size_m = [1.0, 2.0]
    with pytest.raises(cdr.CdrError, match=r"hold_t\.size_m has 2 elements, expected 3"):
        cdr.encode(message)


@pytest.mark.parametrize("vector", FRAMES, ids=lambda v: f"{v['message']}-{v['node']}-{v['counter']}")
def test_can_frames_decode(vector: dict[str, Any]) -> None:
    frame = can_codec.Frame(vector["identifier"], bytes.fromhex(vector["data"]))
    decoded = can_codec.decode(frame)
    expected_node = vector["node"]
    if expected_node is None and not vector["message"].startswith(("Sync", "Broadcast", "Host")):
        expected_node = can_codec.GRIPPER_NODE
    assert (decoded.name, decoded.node) == (vector["message"], expected_node)
    assert decoded.values.pop("Counter") == vector["counter"]
    decoded.values.pop("Crc")
    assert decoded.values == pytest.approx(vector["signals"], rel=1e-12)
    assert can_codec.check(frame, can_codec.Receiver()) is can_codec.Verdict.OK
