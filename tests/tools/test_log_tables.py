"""`crux log export` as tables, CAN frames and a rerun recording: opened with the readers of their tools."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import can
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from crux_contracts import can_codec
from crux_contracts.robot import load_robot
from crux_tools.cli import main
from crux_tools.log.can_files import packed
from crux_tools.log.rerun_file import TIMELINE, blueprint
from crux_tools.telemetry import Telemetry, read_log
from hypothesis import given
from hypothesis import strategies as st
from made_up_climb import Story, made_up_plan, write_log

LIMBS = ("LF", "RF", "LR", "RR")
SILENT_CYCLE, SILENT_JOINT = 33, 8
BEGIN_NS = 1_795_341_600 * 10**9  # date -u -d 2026-11-22T10:00:00 +%s
CAN_READERS: dict[str, Any] = {"candump": can.CanutilsLogReader, "asc": can.ASCReader, "blf": can.BLFReader}


@pytest.fixture(scope="module")
def story_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "climb.mcap"
    story = Story(
        faults=((200, 7, 1),),
        silent=(SILENT_CYCLE, SILENT_JOINT),
        joint_torque_nm=tuple(0.1 * j for j in range(24)),
        metadata={"started_utc": "2026-11-22T10:00:00.000000Z"},
    )
    write_log(path, story)
    return path


@pytest.fixture(scope="module")
def log(story_log: Path) -> Telemetry:
    return read_log(story_log)


def _export(story_log: Path, name: str, *words: str) -> Path:
    out = story_log.with_name(name)
    assert main(["log", "export", str(story_log), "-o", str(out), *words]) == 0
    return out


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_tables_hold_the_numbers_of_the_log(story_log: Path, log: Telemetry, form: str) -> None:
    folder = _export(story_log, f"tables-{form}", f"--{form}", "--utc")
    read = pyarrow.parquet.read_table if form == "parquet" else pyarrow.csv.read_csv
    tables = {path.stem: read(path) for path in folder.iterdir()}
    inputs = tables["control_input"]
    np.testing.assert_array_equal(inputs["joint_torque_nm_LR_joint3"], log.inputs["joint_torque_nm"][:, 14])
    np.testing.assert_array_equal(inputs["joint_fresh_RF_joint3"], log.inputs["joint_fresh"][:, SILENT_JOINT])
    np.testing.assert_allclose(inputs["time_s"], log.time_s, atol=1e-9)
    assert inputs["utc"][100].value == BEGIN_NS + 10**9
    state = tables["robot_state"]
    np.testing.assert_array_equal(state["body_position_w_m_z"], log.state["body_position_w_m"][:, 2])
    np.testing.assert_array_equal(state["body_quaternion_w_w"], log.state["body_quaternion_w"][:, 0])
    for limb, name in enumerate(LIMBS):
        mine = tables[f"{name}_limb_telemetry"]
        np.testing.assert_array_equal(mine["force_w_n_z"], log.limbs["force_w_n"][:, limb, 2])
    events = tables["events"].to_pylist()
    assert [event["time_s"] for event in events if event["text"].startswith("fault")] == [2.0]
    assert set(tables["margins"].column_names) == {"time_s", "utc", *(f"{limb}_margin_n" for limb in LIMBS)}


@pytest.mark.parametrize("form", CAN_READERS)
def test_frames_hold_the_signals_of_the_log(story_log: Path, log: Telemetry, form: str) -> None:
    out = _export(story_log, f"frames.{ {'candump': 'log'}.get(form, form) }", f"--{form}")
    robot = load_robot("scaler")
    receivers: dict[tuple[int, int], can_codec.Receiver] = defaultdict(can_codec.Receiver)
    seen: dict[tuple[int, int], list[tuple[float, can_codec.Decoded]]] = defaultdict(list)
    with CAN_READERS[form](out) as reader:
        for frame in reader:
            assert frame.is_fd
            assert frame.bitrate_switch
            channel = int(str(frame.channel).removeprefix("can"))
            key = (channel, frame.arbitration_id)
            raw = can_codec.Frame(frame.arbitration_id, bytes(frame.data))
            assert can_codec.check(raw, receivers[key]) is can_codec.Verdict.OK
            seen[key].append((frame.timestamp, can_codec.decode(raw)))
    n = len(log.time_s)
    assert len(seen) == 4 * (6 + 6 + 4)
    assert sum(map(len, seen.values())) == n * 4 * 16 - 1
    statuses = seen[1, can_codec.message("JointStatus", 3).frame_id]
    assert len(statuses) == n - 1  # RF joint 3 was silent once
    assert all(round(one.values["CycleEcho"]) != SILENT_CYCLE - 1 for _, one in statuses)
    commands = seen[2, can_codec.message("JointCommand", 3).frame_id]
    rows = [0, n // 2, n - 1]
    for row in rows:
        time_s, command = commands[row]
        assert time_s - commands[0][0] == pytest.approx(log.time_s[row] - log.time_s[0], abs=1e-6)
        assert command.values["Position_rad"] == np.float32(log.outputs["joint_position_rad"][row, 14])
        assert command.values["Kp_Nm_rad"] == robot.servo.position_gain_Nm_rad[2]
        _, status = seen[2, can_codec.message("JointStatus", 3).frame_id][row]
        assert status.values["Torque_Nm"] == pytest.approx(log.inputs["joint_torque_nm"][row, 14], abs=1e-9)
        assert seen[0, can_codec.message("Sync").frame_id][row][1].values["Cycle"] == log.outputs["cycle"][row]


@given(data=st.data(), name=st.sampled_from(["JointStatus", "JointCommand", "GripperStatus", "ForceTorque", "Sync"]))
def test_payloads_are_those_the_codec_makes_one_by_one(data: st.DataObject, name: str) -> None:
    message = can_codec.message(name, 4)
    values: dict[str, float] = {}
    for signal in message.signals:
        if signal.name in {"Crc", "Counter"}:
            continue
        if signal.is_float:
            values[signal.name] = data.draw(st.floats(-100, 100, width=32))
        else:
            least = -(1 << signal.length - 1) if signal.is_signed else 0
            raw = data.draw(st.integers(least, least + (1 << signal.length) - 1))
            values[signal.name] = raw * signal.scale
    counter = data.draw(st.integers(0, 1000))
    mine = packed(message, {key: np.array([value]) for key, value in values.items()}, np.array([counter]))
    assert mine[0].tobytes() == can_codec.encode(name, values, counter, 4).data


@pytest.fixture(scope="module")
def recording(story_log: Path) -> dict[str, list[Any]]:
    """Record batches by entity, as rerun's own reader gives them."""
    from rerun.chunk import RrdReader  # half a second, which not every process that collects tests needs

    found: dict[str, list[Any]] = defaultdict(list)
    for chunk in RrdReader(_export(story_log, "climb.rrd", "--rerun")).stream():
        found[str(chunk.entity_path)].append(chunk.to_record_batch())
    return found


def _column(batches: list[Any], ending: str) -> tuple[np.ndarray, list[Any]]:
    times: list[int] = []
    values: list[Any] = []
    for batch in batches:
        for name in batch.schema.names:
            if name.endswith(ending) and TIMELINE in batch.schema.names:
                times += [int(value.value) for value in batch[TIMELINE]]
                values += batch[name].to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], [values[i] for i in order]


def test_a_rerun_recording_holds_what_the_log_has(recording: dict[str, list[Any]], log: Telemetry) -> None:
    times, torque = _column(recording["/joints/effort/LR/LR_joint3"], "Scalars:scalars")
    rows = np.searchsorted(log.time_s, times / 1e9 - 1e-6)
    assert len(rows) > 100
    np.testing.assert_array_equal(np.array(torque)[:, 0], log.inputs["joint_torque_nm"][rows, 14])
    _, force = _column(recording["/forces/RR/measured_z"], "Scalars:scalars")
    np.testing.assert_array_equal(np.array(force)[:, 0], log.limbs["force_w_n"][rows, 3, 2])
    _, body = _column(recording["/tf/base"], "Transform3D:translation")
    np.testing.assert_allclose(np.array(body)[:, 0], log.state["body_position_w_m"][rows], atol=1e-7)
    _, arrows = _column(recording["/arrows/planned/LF"], "Arrows3D:vectors")
    np.testing.assert_allclose(np.array(arrows)[:, 0] / 0.004, log.limbs["force_reference_w_n"][rows, 0], atol=1e-4)
    when, texts = _column(recording["/events"], "TextLog:text")
    assert [int(t) for t, text in zip(when, texts, strict=True) if text[0].startswith("fault")] == [2 * 10**9]
    ((_, half_sizes),) = [
        _static(batch, "half_sizes") for batch in recording["/wall/holds"] if "half" in str(batch.schema)
    ]
    graspable = [hold for hold in made_up_plan().holds if hold.graspable]
    np.testing.assert_allclose(half_sizes, [np.array(hold.size_m) / 2 for hold in graspable])


def _static(batch: Any, ending: str) -> tuple[str, list[Any]]:
    (name,) = [name for name in batch.schema.names if name.endswith(ending)]
    return name, batch[name].to_pylist()[0]


def test_every_view_of_the_blueprint_shows_something(recording: dict[str, list[Any]]) -> None:
    from rerun.blueprint import View

    def views(part: Any) -> list[Any]:
        inner = getattr(part, "contents", [])
        return [part] if isinstance(part, View) else [view for each in inner for view in views(each)]

    shown = views(blueprint().root_container)
    assert len(shown) > 15
    for view in shown:
        paths = [str(view.origin)] if isinstance(view.contents, str) else [path.rstrip("*/") for path in view.contents]
        for path in paths:
            assert any(entity == path or entity.startswith(f"{path}/") for entity in recording), path


def test_every_link_of_the_robot_is_drawn_in_a_frame_that_moves(recording: dict[str, list[Any]]) -> None:
    frames = {
        frame
        for batches in recording.values()
        for batch in batches
        for name in batch.schema.names
        if name.endswith("Transform3D:child_frame")
        for row in batch[name].to_pylist()
        for frame in row or []
    }
    assert set(load_robot("scaler").urdf.links) <= frames
    assert any("visual_geometries" in entity for entity in recording)


def test_what_was_written_is_counted(story_log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = story_log.with_name("counted.log")
    assert main(["log", "export", str(story_log), "-o", str(out), "--candump", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == len(out.read_text().splitlines())
    assert main(["log", "export", str(story_log), "-o", str(story_log), "--csv"]) == 2
    assert "no folder that can be written in" in capsys.readouterr().err
