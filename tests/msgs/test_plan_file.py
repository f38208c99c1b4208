from __future__ import annotations

import io
import subprocess
import sysconfig
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from crux_contracts import plan_file
from crux_contracts.channels import SCHEMAS
from crux_contracts.plan_file import PlanFileError, from_bytes, plan_id, read_plan, to_bytes, write_plan
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from msgs_golden import sample_plan
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

KNOTS = 13
SMALL = to_bytes(sample_plan({}, knots=2))


def test_a_plan_comes_back_as_it_went(tmp_path: Path) -> None:
    plan = sample_plan()
    write_plan(tmp_path / "plan.mcap", plan)
    again = read_plan(tmp_path / "plan.mcap")
    assert again.encode() == plan.encode()
    assert again.plan_id == plan_id(plan)
    assert len(again.plan_id) == 64


def test_the_same_plan_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_plan(tmp_path / name, sample_plan())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_plan_id_does_not_depend_on_itself_but_on_everything_else() -> None:
    plan = sample_plan()
    first = plan_id(plan)
    plan.plan_id = "anything"
    assert plan_id(plan) == first
    plan.knots[3].limbs[2].friction += 1e-9
    assert plan_id(plan) != first


def test_rosbags_opens_it(tmp_path: Path) -> None:
    plan = sample_plan()
    write_plan(tmp_path / "plan.mcap", plan)
    with AnyReader([tmp_path / "plan.mcap"], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        seen = {connection.topic: connection.msgcount for connection in reader.connections}
        assert seen == {"/plan": 1, "/plan/knot": KNOTS}
        for index, (connection, time_ns, raw) in enumerate(
            reader.messages([c for c in reader.connections if c.topic == "/plan/knot"])
        ):
            message: Any = reader.deserialize(raw, connection.msgtype)
            assert time_ns == round(plan.knots[index].time_s * 1e9)
            assert list(message.body_position_w_m) == list(plan.knots[index].body_position_w_m)
            assert message.limbs[3].hold == plan.knots[index].limbs[3].hold


def test_rerun_opens_it(tmp_path: Path) -> None:
    write_plan(tmp_path / "plan.mcap", sample_plan())
    rerun = Path(sysconfig.get_path("scripts")) / "rerun"
    result = subprocess.run(
        [rerun, "mcap", "info", tmp_path / "plan.mcap"], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "/plan/knot" in result.stdout
    assert "crux_msgs/msg/Plan" in result.stdout


@pytest.mark.parametrize("bit", range(8))
def test_a_flipped_bit_anywhere_is_found(bit: int) -> None:
    for position in range(len(SMALL)):
        damaged = bytearray(SMALL)
        damaged[position] ^= 1 << bit
        with pytest.raises(PlanFileError) as caught:
            from_bytes(bytes(damaged), "p.mcap")
        assert str(caught.value).startswith("p.mcap: ")
        assert "\n" not in str(caught.value)


@settings(deadline=None, max_examples=100)
@given(size=st.integers(0, len(SMALL) - 1))
def test_a_file_cut_short_is_found(size: int) -> None:
    with pytest.raises(PlanFileError, match=r"p\.mcap: (is empty|is not an MCAP file|is damaged or cut short)"):
        from_bytes(SMALL[:size], "p.mcap")


@pytest.mark.parametrize("size", [8, 20, 100])
def test_what_a_cut_file_lacks_is_said_in_words(size: int) -> None:
    with pytest.raises(PlanFileError) as caught:
        from_bytes(SMALL[:size], "p.mcap")
    assert str(caught.value) == "p.mcap: is damaged or cut short: the end of the file is missing"


@settings(deadline=None, max_examples=100)
@given(data=st.binary(max_size=200))
def test_rubbish_behind_the_magic_is_found(data: bytes) -> None:
    with pytest.raises(PlanFileError):
        from_bytes(SMALL[:8] + data + SMALL[-8:], "p.mcap")


def _mcap_with(topic: str, compression_topic: bool = False) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream) if compression_topic else Writer(stream, use_chunking=False)
    writer.start(profile="ros2")
    schema = writer.register_schema("crux_msgs/msg/RobotState", "ros2msg", b"int64 cycle\n")
    channel = writer.register_channel(topic, "cdr", schema)
    writer.add_message(channel, 0, b"\0\1\0\0" + bytes(8), 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def test_other_files_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(PlanFileError, match="is not an MCAP file"):
        from_bytes(b"version: 1\n")
    with pytest.raises(PlanFileError, match="an MCAP file without a plan"):
        from_bytes(_mcap_with("/robot_state"))
    with pytest.raises(PlanFileError, match="another layout"):
        from_bytes(_mcap_with("/plan"))
    with pytest.raises(PlanFileError, match="is zstd-compressed, as logs are: expected a plan written by crux plan"):
        from_bytes(_mcap_with("/plan", compression_topic=True))
    with pytest.raises(PlanFileError, match="No such file"):
        read_plan(tmp_path / "none.mcap")
    with pytest.raises(PlanFileError, match="Is a directory"):
        read_plan(tmp_path)


def test_a_plan_of_a_crux_that_knew_fewer_constants_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    now = SCHEMAS["plan_t"]
    older = "".join(line for line in now.definition.splitlines(keepends=True) if "FORMAT_OWN_TIMES" not in line)
    assert older != now.definition
    with monkeypatch.context() as before:
        before.setitem(SCHEMAS, "plan_t", replace(now, definition=older))
        written = to_bytes(sample_plan())
    assert written != to_bytes(sample_plan())
    assert from_bytes(written).plan_id == from_bytes(to_bytes(sample_plan())).plan_id


def test_huge_files_are_refused_before_reading(tmp_path: Path) -> None:
    path = tmp_path / "huge.mcap"
    with path.open("wb") as file:
        file.truncate(2**40)  # sparse
    with pytest.raises(PlanFileError, match="expected a plan of at most"):
        read_plan(path)


def test_a_changed_plan_with_right_checksums_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_file, "plan_id", lambda _plan: "0" * 64)
    forged = to_bytes(sample_plan())
    monkeypatch.undo()
    with pytest.raises(PlanFileError, match=r"plan_id 0{12}\.\.\. is not this plan's"):
        from_bytes(forged)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("plan.format = 6", "plan format 6, this crux reads formats 1 to 5"),
        (
            "plan.knots[4].body_rpy_rad = [0.0, float('nan'), 0.0]",
            r"knots\[4\]\.body_rpy_rad\[1\] nan, expected numbers of at most 1e\+09",
        ),
        ("plan.gravity_w_m_s2 = [0.0, 1e308, 0.0]", r"gravity_w_m_s2\[1\] 1e\+308, expected numbers of at most 1e\+09"),
        ("plan.patch_k_m = 1e-320", r"patch_k_m .*, expected 0 \(feet on the wall itself\) or at least 1e-06 m"),
        ("plan.knots[4].limbs[1].hold = 99", r"knots\[4\], RF: hold 99, expected -1..7"),
        ("plan.knots[4].time_s = 1e8", r"knots\[4\]\.time_s 1e\+08, expected 0..1.44e\+07"),
        ("plan.knots[4].time_s = -0.1", r"knots\[4\]\.time_s -0.1, expected 0..1.44e\+07"),
        ("plan.n_knots = 3", "knots has 13 elements, expected 3"),
        ("plan.knots = plan.knots[:1]; plan.n_knots = 1", "1 knots, expected 2..4000"),
        ("plan.knots[0].limbs = plan.knots[0].limbs[:3]", "limbs has 3 elements, expected 4"),
    ],
)
def test_a_plan_that_makes_no_sense_is_not_written(change: str, says: str, tmp_path: Path) -> None:
    plan = sample_plan()
    exec(change, {"plan": plan})
    with pytest.raises(PlanFileError, match=says):
        write_plan(tmp_path / "plan.mcap", plan)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(PlanFileError, match="cannot be written: No such file or directory"):
        write_plan(tmp_path / "no" / "plan.mcap", sample_plan())
