"""What the simulation adds to a log, by readers that are none of ours, and what an interruption leaves of the log."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts import cdr, channels
from crux_contracts.robot import load_robot
from crux_msgs import truth_body_t, truth_contacts_t, truth_verdict_t
from crux_simulation.sim import climb as climbing
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.native import contact_period
from crux_simulation.sim.recorder import Truth, recorded
from crux_simulation.sim.world_file import parse_world
from crux_tools.paths import built
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry import read_channels, read_log
from crux_tools.telemetry.append import Series, append
from crux_tools.telemetry.rotations import rotations_from_quaternions
from crux_tools.telemetry.summary import summarise
from crux_tools.telemetry.wording import rows
from hand_plan import climbing_plan
from mcap.reader import make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

OUTPUT = "/control_output"
CYCLES, FLUSHES = 300, 5
ADDED = 200
CDR_HEADER = 4


def by_rosbags(log: Path, topic: str) -> list[tuple[int, Any]]:
    """(log time, message) by a reader with a decoder of its own."""
    with AnyReader([log], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        return [(t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages(wanted)]


def table(messages: list[tuple[int, Any]], name: str, *shape: int) -> Any:
    """(n, *shape) of a field."""
    return np.array([getattr(message, name) for _, message in messages]).reshape(len(messages), *shape)


@pytest.fixture(scope="module")
def climbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[ClimbResult, Truth]:
    """A climb of one limb, and what its recorder saw."""
    seen: list[Truth] = []

    def spied(plant: Any) -> Truth:
        seen.append(recorded(plant))
        return seen[-1]

    log = tmp_path_factory.mktemp("climb") / "log.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(climbing, "recorded", spied)
        plan = climbing_plan(limbs_to_move=(0,))
        windy = parse_world(b"version: 1\nname: windy\n").draw(0, plan)  # that nothing blows in
        result = climbing.climb(plan, load_robot("scaler"), log, climbing.ClimbOptions(world=windy))
    return result, seen[0]


def test_the_log_has_what_the_recorder_saw(climbed: tuple[ClimbResult, Truth]) -> None:
    result, truth = climbed
    n = len(truth.cycle)
    body, contacts = (by_rosbags(result.log, topic) for topic in ("/truth/body", "/truth/contacts"))
    for messages in (body, contacts):
        assert (table(messages, "cycle") == truth.cycle).all()
        assert [time_ns for time_ns, _ in messages] == [2_000_000 * cycle for cycle in truth.cycle]
    np.testing.assert_array_equal(table(body, "position_w_m", 3), truth.body_position_m)
    np.testing.assert_array_equal(table(body, "quaternion_w", 4), truth.body_quaternion)
    np.testing.assert_array_equal(table(body, "climbing"), truth.climbing)
    np.testing.assert_array_equal(table(body, "link_contact_force_n"), truth.link_contact_force_n)
    for name, shape, wanted in (
        ("gripper_position_w_m", (4, 3), truth.gripper_position_m),
        ("hand_force_g_n", (4, 3), truth.hand_wrench_g[:, :, :3]),
        ("hand_moment_g_nm", (4, 3), truth.hand_wrench_g[:, :, 3:]),
        ("pad_position_w_m", (8, 3), truth.pad_position_m),
        ("pad_normal_force_n", (8,), truth.pad_force_n),
    ):
        np.testing.assert_array_equal(table(contacts, name, *shape), wanted.astype(np.float32))
    turned = rotations_from_quaternions(table(contacts, "gripper_quaternion_w", 4 * 4).reshape(-1, 4).astype(float))
    np.testing.assert_allclose(turned.reshape(n, 4, 3, 3), truth.gripper_rotation, atol=1e-6)


def test_the_truth_is_that_of_the_wall_and_of_statics(climbed: tuple[ClimbResult, Truth]) -> None:
    plan = climbing_plan(limbs_to_move=(0,))
    contacts = by_rosbags(climbed[0].log, "/truth/contacts")
    holds, force = table(contacts, "pad_hold", 8), table(contacts, "pad_normal_force_n", 8)
    assert list(holds[-1]) == [4, 4, 1, 1, 2, 2, 3, 3]  # LF has gone from hold 0 to hold 4
    assert {0, 4, truth_contacts_t.NOTHING} == set(holds[:, 0])
    assert (force[-1] > 5).all()
    assert (force[holds == truth_contacts_t.NOTHING] == 0).all()
    planned = [limb.gripper_position_w_m for limb in plan.knots[-1].limbs]
    np.testing.assert_allclose(table(contacts, "gripper_position_w_m", 4, 3)[-1], planned, atol=0.005)
    model = build_model(load_robot("scaler"), plan)
    mass_kg = model.model.body_subtreemass
    carried_kg = mass_kg[model.body] - mass_kg[model.gripper_bodies].sum()
    turned = rotations_from_quaternions(table(contacts, "gripper_quaternion_w", 4, 4)[-1].astype(float))
    sum_w_n = np.einsum("lij,lj->i", turned, table(contacts, "hand_force_g_n", 4, 3)[-1])
    np.testing.assert_allclose(sum_w_n, -carried_kg * np.array(plan.gravity_w_m_s2), atol=1.0)


def test_the_verdict_is_in_the_log_as_json_prints_it(climbed: tuple[ClimbResult, Truth]) -> None:
    result, truth = climbed
    ((time_ns, message),) = by_rosbags(result.log, "/truth/verdict")
    printed = result.as_json()
    assert time_ns == 2_000_000 * truth.cycle[-1]
    for name in ("ok", "reached_goal", "fell", "slips", "largest_slip_m", "log_complete", "reason"):
        assert getattr(message, name) == printed[name], name
    assert (message.goal_error_m, message.goal_error_rad) == tuple(printed["goal_error"].values())
    assert message.ok
    assert message.world == "windy"
    summary = summarise(read_log(result.log))
    told = summary.to_json()["verdict"]
    assert told == {name: getattr(message, name) for name in told}
    head, text = rows(summary)[0]  # of crux replay
    assert head == "verdict"
    assert text.startswith("climbed\n")
    assert text.endswith(f"no slips (largest {message.largest_slip_m * 1e3:.2f} mm), no fall")


def test_rerun_finds_nothing_amiss(climbed: tuple[ClimbResult, Truth]) -> None:
    rerun = Path(sys.executable).with_name("rerun")
    done = subprocess.run([rerun, "mcap", "check", climbed[0].log], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = [line.split() for line in done.stdout.splitlines() if "/" in line][1:]
    assert {row[0] for row in found} == {"ok"}
    assert {"/truth/body", "/truth/contacts", "/truth/verdict"} <= {row[3] for row in found}


def test_the_table_says_how_often_the_simulation_looks() -> None:
    every = {row["name"]: row.get("log_every", 1) for row in _table()}
    assert every[channels.CRUX_TRUTH_BODY] == every[channels.CRUX_TRUTH_CONTACTS] == contact_period()


def _table() -> list[dict[str, Any]]:
    import yaml

    text = (Path(__file__).parents[2] / "msgs/channels.yaml").read_text(encoding="utf-8")
    found: list[dict[str, Any]] = yaml.safe_load(text)["channels"]
    return found


# ---- the end of the file


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """By the runtime's own writer: a log that it ended, and what a kill left of it."""
    folder = tmp_path_factory.mktemp("logs")
    program = built("tests/runtime/shell/log_steps")
    subprocess.run([program, folder / "log.mcap", str(FLUSHES), str(CYCLES), folder], capture_output=True, check=True)
    steps = sorted(folder.glob("*-*.mcap"), key=lambda step: int(step.stem.split("-")[0]))
    killed = [step for step in steps if step.stem.endswith(f"-{CYCLES * (FLUSHES - 2)}")]
    return {"ended": folder / "log.mcap", "killed": killed[0]}


def series() -> list[Series]:
    """Messages that tell where they belong, and one of a size of its own."""
    message = truth_body_t()
    message.position_w_m, message.quaternion_w = [0.0] * 3, [1.0, 0.0, 0.0, 0.0]
    payloads = []
    for message.cycle in range(ADDED):
        payloads.append(cdr.encode(message))
    times_ns = [10 * cycle for cycle in range(ADDED)]
    return [Series("/truth/body", times_ns, payloads), Series("/truth/verdict", [7], [cdr.encode(truth_verdict_t())])]


def copied(log: Path, to: Path) -> Path:
    shutil.copy(log, to)
    return to


def cycle_of(payload: bytes) -> int:
    return int(struct.unpack_from("<q", payload, CDR_HEADER)[0])


def cycles_by_crux(log: Path, topic: str) -> list[int]:
    tables = read_channels(log, {topic}).tables
    return [int(cycle) for cycle in tables[topic]["cycle"]] if topic in tables else []


def cycles_by_mcap(log: Path, topic: str) -> list[int]:
    with log.open("rb") as file:
        return [cycle_of(message.data) for _, _, message in make_reader(file).iter_messages(topics=[topic])]


def cycles_by_rosbags(log: Path, topic: str) -> list[int]:
    with AnyReader([log]) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        return [cycle_of(payload) for _, _, payload in reader.messages(wanted)] if wanted else []


READERS: list[Callable[[Path, str], list[int]]] = [cycles_by_crux, cycles_by_mcap, cycles_by_rosbags]


@pytest.mark.parametrize("kind", ["ended", "killed"])
def test_a_log_takes_more_channels_and_keeps_what_it_had(tmp_path: Path, kind: str, logs: dict[str, Path]) -> None:
    log = copied(logs[kind], tmp_path / "log.mcap")
    old, before = log.read_bytes(), read_channels(log)
    assert not any(topic.startswith("/truth") for topic in before.times_ns)  # the runtime does not know of them
    append(log, series())
    assert log.read_bytes().startswith(old[: len(old) - 50_000])
    for cycles_by in READERS:
        assert cycles_by(log, OUTPUT) == cycles_by(logs[kind], OUTPUT) != []
        assert cycles_by(log, "/truth/body") == list(range(ADDED))
    now = read_channels(log)
    assert (now.metadata, now.end, now.notes) == (before.metadata, before.end, before.notes)
    assert list(now.attachments) == list(before.attachments)
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
        if kind == "killed":
            assert summary is None
            return
        assert summary is not None
        _look_at_summary(file, summary, old)


def _look_at_summary(file: Any, summary: Any, old: bytes) -> None:
    """It says what is in the file, every index points at its record, and the checksums are those of the bytes."""
    file.seek(0)
    records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) == len(chunks)
    assert (
        summary.statistics.channel_count == len(summary.channels) == len({c.topic for c in summary.channels.values()})
    )
    counted = summary.statistics.channel_message_counts
    assert summary.statistics.message_count == sum(counted.values()) > ADDED
    assert {summary.channels[number].topic: count for number, count in counted.items()}["/truth/body"] == ADDED
    for index, chunk in zip(summary.chunk_indexes, chunks, strict=True):
        file.seek(index.chunk_start_offset + 9)
        assert file.read(16) == struct.pack("<QQ", chunk.message_start_time, chunk.message_end_time)
        for channel_id, offset in index.message_index_offsets.items():
            file.seek(offset)
            assert struct.unpack("<BQH", file.read(11))[::2] == (7, channel_id)  # opcode of a MessageIndex
    assert sum(isinstance(record, MessageIndex) for record in records) == sum(
        len(index.message_index_offsets) for index in summary.chunk_indexes
    )
    file.seek(0)
    data = file.read()
    summary_at, _, crc = struct.unpack("<QQI", data[-28:-8])
    assert zlib.crc32(data[summary_at:-12]) == crc
    old_at = struct.unpack("<Q", old[-28:-20])[0]
    assert struct.unpack("<I", old[old_at - 4 : old_at])[0] != 0  # the runtime writes a checksum of its data,
    assert struct.unpack("<I", data[summary_at - 4 : summary_at])[0] != 0  # so there is one after it, too


@pytest.mark.parametrize("kind", ["ended", "killed"])
def test_an_interruption_at_any_time_costs_nothing_of_the_log(
    tmp_path: Path, kind: str, logs: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = copied(logs[kind], tmp_path / "log.mcap")
    wanted = cycles_by_mcap(log, OUTPUT)
    steps: list[Path] = []
    write = os.pwrite

    def halves(file: int, data: Any, at: int) -> int:
        """As a kill in the middle of a write, and right behind it, would leave the file."""
        half = len(data) // 2
        for part, place in ((data[:half], at), (data[half:], at + half)):
            assert write(file, part, place) == len(part)
            steps.append(copied(log, tmp_path / f"step{len(steps)}.mcap"))
        return len(data)

    monkeypatch.setattr(os, "pwrite", halves)
    append(log, series())
    assert len(steps) >= 8
    ended = read_channels(logs[kind]).end
    for step in steps:
        assert cycles_by_crux(step, OUTPUT) == wanted, step.name
        assert read_channels(step).end == ended, step.name
    for step in steps[1::2]:  # whole writes: by a reader that begins at the end
        assert cycles_by_mcap(step, OUTPUT) == wanted, step.name


def test_a_log_that_may_not_grow_is_as_it_was(tmp_path: Path, logs: dict[str, Path]) -> None:
    log = copied(logs["ended"], tmp_path / "log.mcap")
    before = log.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 3000, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            append(log, series())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert log.read_bytes() == before


@pytest.mark.parametrize("good", range(3))
def test_a_log_that_finds_no_space_on_the_way_is_as_it_was(
    tmp_path: Path, good: int, logs: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = copied(logs["ended"], tmp_path / "log.mcap")
    before, write, done = log.read_bytes(), os.pwrite, [0]

    def full(file: int, data: bytes, at: int) -> int:
        """The first writes find their place, of the next one a half."""
        done[0] += 1
        if done[0] > good + 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(file, data[: len(data) // 2] if done[0] > good else data, at)

    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(OSError, match="No space left"):
        append(log, series())
    assert log.read_bytes() == before


@pytest.mark.parametrize("cut", [0, 3, 40, 5000, -1])
def test_a_file_that_does_not_end_like_a_log_stays_as_it_is(tmp_path: Path, cut: int, logs: dict[str, Path]) -> None:
    log = tmp_path / "log.mcap"
    log.write_bytes(logs["ended"].read_bytes()[:cut])
    before = log.read_bytes()
    with pytest.raises(ValueError, match="does not end like"):
        append(log, series())
    assert log.read_bytes() == before
