"""plan.mcap: a checked plan as a file that rosbags, rerun and any other MCAP reader can open.

Profile ros2, uncompressed, CDR with ros2msg schemas: topic /plan has the whole plan (crux_msgs/msg/Plan) at time 0,
/plan/knot every knot (crux_msgs/msg/PlanKnot) at its own time; the scenario is attached as scenario.yaml. The same plan
gives the same bytes.
"""

from __future__ import annotations

import hashlib
import io
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crux_msgs import hold_t, plan_t
from crux_msgs.tables import MEMBERS
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from . import LIMB_NAMES, cdr
from .channels import BY_NAME, CRUX_PLAN, SCHEMAS
from .output_file import write_whole

PLAN_TOPIC = BY_NAME[CRUX_PLAN].topic
KNOT_TOPIC = f"{PLAN_TOPIC}/knot"
ATTACHMENT = "scenario.yaml"
LIBRARY = "crux"
FORMATS = range(plan_t.FORMAT, plan_t.FORMAT_FEET + 1)
MAX_BYTES = 32_000_000
MAX_KNOTS = 4000
MAX_HOLDS = 1000
MIN_DT_S, MAX_DT_S = 1e-3, 3600.0
MAX_TIME_S = MAX_KNOTS * MAX_DT_S
MAX_NUMBER = 1e9  # more than any metre, newton or second of a plan, and its powers do not overflow
MIN_PATCH_K_M = 1e-6
_FOOTER_LENGTH = 1 + 8 + 20 + 8  # opcode, length, content, magic
_DATA_END = struct.pack("<BQ", Opcode.DATA_END, 4)  # opcode, length; the checksum follows, then the summary


class PlanFileError(Exception):
    """A plan file that cannot be read or is not to be trusted; str() is one line with the file's name."""


class _DamagedError(Exception):
    """str() is what is missing or wrong."""


class _CompressedError(Exception):
    """str() is the compression."""


def plan_id(plan: plan_t) -> str:
    """SHA-256 (hex) of the plan's LCM encoding with plan_id empty."""
    given = plan.plan_id
    plan.plan_id = ""
    try:
        return hashlib.sha256(plan.encode()).hexdigest()
    finally:
        plan.plan_id = given


def to_bytes(plan: plan_t) -> bytes:
    """The file's content. Sets plan.plan_id. Raises PlanFileError for a plan that read_plan would refuse."""
    try:
        cdr.encode(plan)  # tells what lcm's own encoder would only stumble over
        plan.plan_id = plan_id(plan)
        body = cdr.encode(plan)
        knots = [cdr.encode(knot) for knot in plan.knots]
    except (cdr.CdrError, AttributeError) as error:
        raise PlanFileError(f"plan: {error}") from None
    _check(plan, "plan")
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE, chunk_size=MAX_BYTES, enable_data_crcs=True)
    writer.start(profile="ros2", library=LIBRARY)
    channels = []
    for topic, type_name in ((PLAN_TOPIC, "plan_t"), (KNOT_TOPIC, "plan_knot_t")):
        schema = SCHEMAS[type_name]
        schema_id = writer.register_schema(schema.name, "ros2msg", schema.definition.encode())
        channels.append(writer.register_channel(topic, "cdr", schema_id))
    writer.add_message(channels[0], log_time=0, publish_time=0, data=body)
    for index, (knot, data) in enumerate(zip(plan.knots, knots, strict=True)):
        time_ns = round(knot.time_s * 1e9)
        writer.add_message(channels[1], log_time=time_ns, publish_time=time_ns, sequence=index, data=data)
    writer.add_attachment(0, 0, ATTACHMENT, "application/yaml", plan.scenario_yaml.encode())
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def write_plan(path: str | Path, plan: plan_t) -> None:
    """Writes the file whole or not at all. Sets plan.plan_id. Raises PlanFileError or, as write_whole, OutputError."""
    data = to_bytes(plan)
    try:
        write_whole(Path(path), data)
    except OSError as error:
        raise PlanFileError(f"{path}: cannot be written: {error.strerror}") from error


def read_plan(path: str | Path) -> plan_t:
    """Reads and verifies a plan: checksums, plan_id, format, sizes, numbers. Raises PlanFileError."""
    try:
        size = Path(path).stat().st_size
        if size > MAX_BYTES:
            raise PlanFileError(f"{path}: {size} bytes, expected a plan of at most {MAX_BYTES} bytes")
        data = Path(path).read_bytes()
    except OSError as error:
        raise PlanFileError(f"{path}: cannot be read: {error.strerror}") from error
    return from_bytes(data, str(path))


def from_bytes(data: bytes, name: str = "plan") -> plan_t:
    """As read_plan, from the file's content; `name` stands in messages."""
    if not data:
        raise PlanFileError(f"{name}: is empty, expected a plan written by crux plan")
    if data[:5] != b"\x89MCAP":
        raise PlanFileError(f"{name}: is not an MCAP file, expected a plan written by crux plan")
    payload = _plan_payload(data, name)
    try:
        plan = cdr.decode("plan_t", payload)
    except cdr.CdrError as error:
        raise PlanFileError(f"{name}: the plan in it cannot be decoded: {error}") from None
    assert isinstance(plan, plan_t)
    _check(plan, name)
    if plan.plan_id != plan_id(plan):
        raise PlanFileError(
            f"{name}: plan_id {plan.plan_id[:12]}... is not this plan's: it was changed after its check"
        )
    return plan


def _plan_payload(data: bytes, name: str) -> bytes:
    """CDR bytes of the one message on /plan."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    payloads = []
    try:
        _check_summary(data)
        for record in _records(data):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and channels[record.channel_id].topic == PLAN_TOPIC:
                payloads.append((schemas[channels[record.channel_id].schema_id], record.data))
    except _CompressedError as error:
        raise PlanFileError(
            f"{name}: is {error}-compressed, as logs are: expected a plan written by crux plan"
        ) from None
    except _DamagedError as error:
        raise PlanFileError(f"{name}: is damaged or cut short: {error}") from None
    except Exception:  # the mcap library raises a dozen unrelated kinds for damaged bytes
        raise PlanFileError(f"{name}: is damaged or cut short: a record cannot be read") from None
    if len(payloads) != 1:
        what = "a climb's log, not a plan" if payloads or len(channels) > 2 else "an MCAP file without a plan"
        raise PlanFileError(f"{name}: is {what}: {len(payloads)} messages on {PLAN_TOPIC}, expected 1")
    schema, payload = payloads[0]
    wanted = SCHEMAS["plan_t"]
    if schema.name != wanted.name or _fields(schema.data.decode("utf-8", "replace")) != _fields(wanted.definition):
        raise PlanFileError(f"{name}: its plan has another layout ({schema.name}): plan it again with this crux")
    return payload


def _records(data: bytes) -> Iterator[Any]:
    for record in StreamReader(
        io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data)
    ).records:
        if not isinstance(record, Chunk):
            yield record
        elif record.compression:
            # Nothing of ours is compressed, so nothing can unfold into more than the file's size.
            raise _CompressedError(record.compression[:16])
        else:
            yield from breakup_chunk(record, validate_crc=True)


def _check_summary(data: bytes) -> None:
    """The library checks the data section's checksum, where it finds that record, but not the summary's."""
    footer_start = len(data) - _FOOTER_LENGTH
    if footer_start < 0:
        raise _DamagedError("the end of the file is missing")
    opcode, length, summary_start, _, crc = struct.unpack_from("<BQQQI", data, footer_start)
    if opcode != Opcode.FOOTER or length != struct.calcsize("<QQI") or data[-8:] != data[:8]:
        raise _DamagedError("the end of the file is missing")
    if crc == 0 or summary_start > footer_start or zlib.crc32(data[summary_start : len(data) - 12]) != crc:
        raise _DamagedError("the summary's checksum is wrong")
    if data[max(summary_start - len(_DATA_END) - 4, 0) :][: len(_DATA_END)] != _DATA_END:
        raise _DamagedError("the data section's checksum is missing")


def _fields(definition: str) -> list[str]:
    """The lines that lay a message out; its constants do not."""
    return [line for line in definition.splitlines() if not re.match(r"\s*\w+ \w+\s*=", line)]


def _check(plan: plan_t, name: str) -> None:
    """Sizes and numbers; whether the plan can be climbed is for checker and runtime to judge."""
    if plan.format not in FORMATS:
        raise PlanFileError(f"{name}: plan format {plan.format}, this crux reads formats {FORMATS[0]} to {FORMATS[-1]}")
    for what, count, low, high in (("knots", plan.n_knots, 2, MAX_KNOTS), ("holds", plan.n_holds, 0, MAX_HOLDS)):
        if not low <= count <= high:
            raise PlanFileError(f"{name}: {count} {what}, expected {low}..{high}")
    wrong = _out_of_range(plan, "plan_t", "")
    if wrong:
        raise PlanFileError(f"{name}: {wrong}, expected numbers of at most {MAX_NUMBER:g}")
    if plan.patch_k_m != 0.0 and plan.patch_k_m < MIN_PATCH_K_M:
        expected = f"expected 0 (feet on the wall itself) or at least {MIN_PATCH_K_M:g} m"
        raise PlanFileError(f"{name}: patch_k_m {plan.patch_k_m:g}, {expected}")
    if not MIN_DT_S <= plan.dt_s <= MAX_DT_S:
        raise PlanFileError(f"{name}: dt_s {plan.dt_s:g}, expected {MIN_DT_S:g}..{MAX_DT_S:g}")
    for index, hold in enumerate(plan.holds):
        size_m = hold.size_m[:2] if hold.graspable == hold_t.FOOTHOLD else hold.size_m
        if min(size_m) <= 0.0:
            raise PlanFileError(f"{name}: holds[{index}].size_m {list(hold.size_m)}, expected lengths above 0")
        if hold.graspable == hold_t.FOOTHOLD and plan.format < plan_t.FORMAT_FEET:
            raise PlanFileError(f"{name}: holds[{index}] is a foothold, expected those in format {plan_t.FORMAT_FEET}")
    for index, knot in enumerate(plan.knots):
        if not 0.0 <= knot.time_s <= MAX_TIME_S:
            raise PlanFileError(f"{name}: knots[{index}].time_s {knot.time_s:g}, expected 0..{MAX_TIME_S:g}")
        step_s = knot.time_s - plan.knots[index - 1].time_s if index else MIN_DT_S + knot.time_s
        if plan.format >= plan_t.FORMAT_OWN_TIMES and not MIN_DT_S <= step_s <= (MAX_DT_S if index else MIN_DT_S):
            expected = f"{MIN_DT_S:g}..{MAX_DT_S:g} s after the knot before" if index else "0"
            raise PlanFileError(f"{name}: knots[{index}].time_s {knot.time_s:g}, expected {expected}")
        for limb, limb_knot in zip(LIMB_NAMES, knot.limbs, strict=True):
            if not -1 <= limb_knot.hold < plan.n_holds:
                place = f"knots[{index}], {limb}: hold {limb_knot.hold}"
                raise PlanFileError(f"{name}: {place}, expected -1..{plan.n_holds - 1}")


def _out_of_range(message: Any, type_name: str, place: str) -> str | None:
    for member, kind, dimension in MEMBERS[type_name]:
        values = getattr(message, member)
        for index, value in enumerate([values] if dimension is None else values):
            where = f"{place}{member}" + ("" if dimension is None else f"[{index}]")
            if kind == "double" and not abs(value) <= MAX_NUMBER:
                return f"{where} {value:g}"
            if kind in MEMBERS:
                wrong = _out_of_range(value, kind, f"{where}.")
                if wrong:
                    return wrong
    return None
