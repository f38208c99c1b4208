"""CAN frames of a climb: around a fault without being asked for, checked again, and written for other tools."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import ROBOTS, load_robot
from crux_msgs import can_frames_t
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.world_file import parse_world
from crux_tools.cli import main
from crux_tools.log import edit
from crux_tools.replay import bus_check
from crux_tools.telemetry import read_channels
from crux_tools.telemetry.can_frames import CHECKED, can_frames_of, read_can_frames
from crux_tools.telemetry.channels import CAN_FRAMES, Payloads, read_payloads
from hand_plan import climbing_plan, standing_plan
from mcap.records import Message

BEFORE_S, AFTER_S, DT_S = 2.0, 1.0, 0.002
SLICK = "version: 1\nname: test\nholds: {h4: {friction_factor: 0.03}}\n"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot that stands, with the frames of every cycle."""
    log = tmp_path_factory.mktemp("frames") / "log.mcap"
    climb(standing_plan(), load_robot("scaler"), log, ClimbOptions(log_frames=True))
    return log


@pytest.mark.usefixtures("briefly_watched")
def test_the_seconds_around_a_fault_are_there_unasked(tmp_path: Path) -> None:
    plan, log = climbing_plan(limbs_to_move=(0, 1)), tmp_path / "log.mcap"
    climb(plan, load_robot("scaler"), log, ClimbOptions(world=parse_world(SLICK.encode()).draw(0, plan)))
    (fault,) = read_channels(log, {"/fault"}).tables["/fault"]
    cycles, last = read_can_frames(log).cycles, read_channels(log, {"/robot_state"}).tables["/robot_state"]["cycle"][-1]
    first = int(fault["cycle"]) - round(BEFORE_S / DT_S)
    end = min(int(fault["cycle"]) + round(AFTER_S / DT_S), int(last))
    assert cycles.tolist() == list(range(first, end + 1))


def test_the_checks_come_out_as_the_runtime_counted(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(whole), "--check", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    frames = read_can_frames(whole)
    assert told["bus"] == {"frames": int((frames.direction == can_frames_t.RECEIVED).sum()), "first_difference": None}
    assert told["cycles"] == len(frames.cycles)


def damaged(source: Path, target: Path, change: bytes) -> None:
    """A copy in which a status of RF's second joint, in cycle 400, has another byte."""

    def changed(record: Message) -> Message:
        frames = can_frames_of(Payloads({CAN_FRAMES: [record.data]}, {CAN_FRAMES: [0]}, {}, {}, {}, {}))
        if frames.cycles[0] != 400:
            return record
        row = np.flatnonzero((frames.bus == 1) & (frames.identifier == 0x182))[0]
        payload = frames.payload(row)
        assert record.data.count(payload) == 1
        record.data = record.data.replace(payload, payload[:2] + change + payload[3:])
        return record

    damage, definitions, copy = edit.Damage(), edit._Definitions(), edit.Copy(target)
    for record in edit.records(source, damage):
        known = definitions.take(record, source)
        if known is None:
            copy.other(record)
        else:
            copy.message(*known, changed(record) if known[0].topic == CAN_FRAMES else record)
    copy.close()


def test_a_frame_that_is_another_one_is_found(whole: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    damaged(whole, log, b"\x07")
    found = bus_check.checked(read_payloads(log, CHECKED))
    assert found is not None
    assert found.first_difference == "cycles 351 to 401, RF: crc_errors 0 in /bus_health, 1 by /can_frames"


@pytest.fixture
def written(whole: Path, tmp_path: Path) -> Iterator[can.CanutilsLogReader]:
    out = tmp_path / "climb.log"
    assert main(["log", "export", str(whole), "-o", str(out), "--candump"]) == 0
    with can.CanutilsLogReader(out) as reader:
        yield reader


def test_candump_has_the_frames_of_the_log(whole: Path, written: can.CanutilsLogReader) -> None:
    frames, messages = read_can_frames(whole), list(written)
    assert [each.arbitration_id for each in messages] == frames.identifier.tolist()
    assert all(bytes(each.data) == frames.payload(row) for row, each in enumerate(messages))
    assert {each.arbitration_id for each in messages if each.arbitration_id > 0x700}  # heartbeats, which no signal has
    times_s = np.array([each.timestamp for each in messages])
    assert np.all((times_s >= frames.log_ns / 1e9 - 1e-6) & (times_s <= frames.log_ns / 1e9 + DT_S + 1e-6))


def test_frames_are_made_of_joints_with_any_names(tmp_path: Path, whole: Path) -> None:
    robot_folder, log, out = tmp_path / "scaler", tmp_path / "log.mcap", tmp_path / "made.log"
    shutil.copytree(ROBOTS / "scaler", robot_folder)
    for file in ("robot.yaml", "scaler.urdf"):
        path = robot_folder / file
        path.write_text(re.sub(r"joint(?=[1-6])", "axis", path.read_text(encoding="utf-8")), encoding="utf-8")
    robot, plan = load_robot(robot_folder), standing_plan()
    plan.robot_sha256 = robot.hash
    plan.plan_id = plan_id(plan)
    climb(plan, robot, log, ClimbOptions())
    assert main(["log", "export", str(log), "-o", str(out), "--candump"]) == 0
    with can.CanutilsLogReader(out) as reader:
        made = {message.arbitration_id for message in reader}
    cyclic = {each for each in read_can_frames(whole).identifier.tolist() if 0x100 < each < 0x700}  # not heartbeats
    assert made >= cyclic
