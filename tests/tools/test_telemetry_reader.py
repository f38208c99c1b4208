"""The log reader against mcap-ros2-support, which shares no code with it, and against damaged files."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from crux_msgs.tables import MEMBERS, SCHEMAS
from crux_tools.errors import UsageError
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry import LogError, read_channels, read_log
from crux_tools.telemetry.cdr_table import fixed_dtype
from crux_tools.telemetry.summary import summarise
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_climb import START, Story, write_log
from mcap.reader import make_reader
from mcap_ros2._dynamic import serialize_dynamic
from mcap_ros2.decoder import DecoderFactory

FIXED = sorted(name for name in SCHEMAS if fixed_dtype(SCHEMAS[name][1]) is not None)


def _value(kind: str) -> st.SearchStrategy[float]:
    if kind in {"double", "float"}:
        return st.floats(allow_nan=False, width=32 if kind == "float" else 64)
    bits = int(kind.removeprefix("int").removesuffix("_t"))
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def test_every_message_of_every_cycle_has_a_fixed_layout() -> None:
    per_cycle = {"robot_state_t", "control_input_t", "control_output_t", "limb_reference_t", "limb_telemetry_t"}
    assert per_cycle | {"cycle_timing_t", "fault_t"} <= set(FIXED)
    assert "plan_t" not in FIXED
    assert "command_t" not in FIXED


@pytest.mark.parametrize("name", FIXED)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_a_record_equals_what_another_encoder_wrote(name: str, data: st.DataObject) -> None:
    schema_name, definition = SCHEMAS[name]
    message: dict[str, object] = {}
    for member, kind, dimension in MEMBERS[name]:
        one = _value(kind)
        if dimension is None:
            message[member] = data.draw(one)
        else:
            count = int(dimension)
            message[member] = data.draw(st.lists(one, min_size=count, max_size=count))
    payload = serialize_dynamic(schema_name, definition)[schema_name](message)
    dtype = fixed_dtype(definition)
    assert dtype is not None
    assert len(payload) == dtype.itemsize
    record = np.frombuffer(payload, dtype)[0]
    for member, value in message.items():
        np.testing.assert_array_equal(record[member], np.asarray(value))


def test_rows_are_those_another_reader_finds(log_path: Path) -> None:
    log = read_log(log_path)
    with log_path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = [f"/{limb}/limb_telemetry" for limb in ("LF", "RF", "LR", "RR")]
        expected = [message for *_, message in reader.iter_decoded_messages(topics=topics)]
    assert log.limbs.shape == (len(expected) // 4, 4)
    for index in (0, 777, len(expected) - 1):
        row, limb = divmod(index, 4)
        assert expected[index].limb == limb
        np.testing.assert_array_equal(log.limbs["force_w_n"][row, limb], expected[index].force_w_n)
    assert log.end == {"cycles": str(len(log.time_s)), "dropped_records": "0"}
    assert log.notes == []
    assert [hold.name for hold in log.plan.holds] == ["a", "b", "c", "d", "e", "pillar"]
    assert list(log.plan.holds[1].position_w_m[:2]) == list(START["RF"])


def test_a_killed_runtimes_log_opens_as_far_as_it_was_written(log_path: Path, killed_log_path: Path) -> None:
    whole, killed = read_log(log_path), read_log(killed_log_path)
    assert 0 < len(killed.time_s) < len(whole.time_s)
    np.testing.assert_array_equal(killed.state, whole.state[: len(killed.state)])
    assert killed.end is None
    assert any("not closed" in remark for remark in killed.notes)


def test_a_killed_runtimes_log_may_be_a_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "flushed.mcap"
    write_log(path, Story(ready_cycles=3, wait_cycles=0, whole_file=True), finish=False)
    assert any("not closed" in remark for remark in read_log(path).notes)


def test_cycles_the_log_had_no_room_for_are_told(tmp_path: Path) -> None:
    path = tmp_path / "dropped.mcap"
    write_log(path, Story(ready_cycles=3, wait_cycles=0, dropped=12))
    assert read_log(path).notes == ["12 cycles are missing: the log's queue was full"]


def test_a_log_cut_anywhere_opens_or_says_why_not(log_path: Path, tmp_path: Path) -> None:
    data = log_path.read_bytes()
    whole = read_log(log_path)
    cut = tmp_path / "cut.mcap"
    opened = []
    for length in np.linspace(0, len(data) - 1, 24).astype(int):
        cut.write_bytes(data[:length])
        try:
            log = read_log(cut)
        except LogError as error:
            refused = str(error)
            opened.append(0)
        else:
            assert log.end is None
            np.testing.assert_array_equal(log.inputs, whole.inputs[: len(log.inputs)])
            opened.append(len(log.inputs))
    assert str(cut) in refused
    assert opened == sorted(opened)
    assert len(set(opened)) > 5


FLIPPED = {"where": st.floats(0, 1, exclude_max=True), "bit": st.integers(0, 7)}


@settings(max_examples=25, deadline=None)
@given(**FLIPPED)
def test_a_flipped_bit_never_crashes_the_reader(log_path: Path, where: float, bit: int) -> None:
    flip_a_bit(log_path, where, bit)


@pytest.mark.sweep
@settings(max_examples=1000, deadline=None)
@given(**FLIPPED)
def test_none_of_many_flipped_bits_crashes_the_reader(log_path: Path, where: float, bit: int) -> None:
    flip_a_bit(log_path, where, bit)


whole_log = cache(read_log)


def flip_a_bit(log_path: Path, where: float, bit: int) -> None:
    """Of a log, which is refused by name, or read as the whole one is."""
    data = bytearray(log_path.read_bytes())
    data[int(where * len(data))] ^= 1 << bit
    flipped = log_path.with_name("flipped.mcap")
    flipped.write_bytes(data)
    whole = whole_log(log_path)
    try:
        log = read_log(flipped)
    except LogError as error:
        message = str(error)
    else:
        message = str(flipped)
        rows = np.searchsorted(whole.time_s, log.time_s)
        np.testing.assert_array_equal(log.limbs, whole.limbs[rows])
    assert str(flipped) in message


def test_what_is_no_log_is_named(tmp_path: Path) -> None:
    text = tmp_path / "text.mcap"
    text.write_text("version: 1\n")
    empty = tmp_path / "empty.mcap"
    empty.touch()
    for path, words in (
        (text, "not an MCAP file"),
        (empty, "not an MCAP file"),
        (tmp_path, "is a folder"),
        (tmp_path / "missing.mcap", "no such file"),
    ):
        with pytest.raises(LogError, match=words) as caught:
            read_channels(path)
        assert str(path) in str(caught.value)


def test_cycles_without_all_limbs_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "short.mcap"
    write_log(path, Story(ready_cycles=3, holding_cycles=1, wait_cycles=0))
    log = read_log(path)
    assert len(log.state) == len(log.limbs) == len(log.references) == len(log.inputs)
    np.testing.assert_array_equal(log.state["cycle"], log.inputs["cycle"])
    np.testing.assert_allclose(log.time_s, log.state["time_s"], atol=1e-9)


def test_logs_of_earlier_runtimes_stay_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    added = {
        "control_input_t": ("int8[4] bus_state\n", "float64 command_value\n"),
        "cycle_timing_t": ("int64 answer_ns\n",),
        "limb_telemetry_t": ("float64 utilisation\n",),
        "robot_state_t": ("int8 motion\n", "float64 verified_time_s\n", "float64 speed_scale\n"),
    }
    for type_, line in ((type_, line) for type_, lines in added.items() for line in lines):
        name, definition = SCHEMAS[type_]
        assert line in definition
        monkeypatch.setitem(SCHEMAS, type_, (name, definition.replace(line, "")))
    path = tmp_path / "old.mcap"
    write_log(path)
    log = read_log(path)
    assert len(log.state) > 0
    assert "bus_state" not in (log.inputs.dtype.names or ())
    assert summarise(log).states
    with pytest.raises(UsageError, match=r"/control_input is of another crux \(commit .*\), which alone"):
        recompute(path)
