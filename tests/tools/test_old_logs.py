"""Logs of every format since the first, some cycles of each around the start of a climb (`crux log cut`), open today.

A change of a message in the log comes with a log of the format before, in tests/tools/logs; those that are there stay.
"""

from __future__ import annotations

import json
from pathlib import Path

import crux_msgs
import numpy as np
import pytest
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import BY_NAME, CHANNELS, LOG_FORMAT, SCHEMAS, log_topics
from crux_msgs import robot_state_t
from crux_tools.cli import main
from crux_tools.log.lcm_command import messages
from crux_tools.paths import ROOT
from crux_tools.report.command import write_report
from crux_tools.telemetry import read_log
from crux_tools.telemetry.summary import summarise
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

LOGS = sorted((ROOT / "tests" / "tools" / "logs").glob("*.mcap"))
# By the log: lines of definitions that its format has, and one that came later.
FORMATS: dict[str, tuple[list[tuple[str, str]], tuple[str, str] | None]] = {
    "1-walk": ([("/control_input", "int8[4] bus_state")], ("/command", "int8 FORCE_SHUTDOWN=7")),
    "2-shutdown": ([("/command", "int8 FORCE_SHUTDOWN=7")], ("/command", "int8 STEP=8")),
    "3-described": ([("/control_input", "int8[4] bus_state")], ("/command", "int8 FORCE_SHUTDOWN=7")),
    "4-slip": ([("/limb_telemetry", "float64 slip_m")], ("/limb_telemetry", "float64 utilisation")),
    "5-speed": ([("/limb_telemetry", "float64 utilisation")], ("/limb_telemetry", "float64 slip_m")),
    "6-residuals": (
        [("/limb_telemetry", "float64 utilisation"), ("/limb_telemetry", "float64 slip_m")],
        ("/limb_telemetry", "float64 borne_friction"),
    ),
    "7-grasps": ([("/limb_telemetry", "float64 borne_friction")], ("/LF/limb_telemetry", "int8 limb")),
    "8-frames": (
        [("/LF/limb_telemetry", "int8 limb"), ("/can_frames", "uint8[] data")],
        ("/LF/limb_telemetry", "float64[6] admittance_gains"),
    ),
    "9-gains": ([("/LF/limb_telemetry", "float64[6] admittance_gains")], ("/restart", "int32 interval")),
    "10-restarts": ([("/LF/limb_telemetry", "float64[6] admittance_gains")], ("/plan", "int32 FORMAT_OWN_TIMES=3")),
    "11-times": ([("/plan", "int32 FORMAT_OWN_TIMES=3")], ("/plan", "int32 FORMAT_MOVING_FINGERS=4")),
    "12-fingers": ([("/plan", "int32 FORMAT_MOVING_FINGERS=4")], ("/plan", "float64[4] lean_rad")),
    "13-leaning": ([("/plan", "float64[4] lean_rad")], ("/plan", "float64[2] tilt_rad")),
    "14-turned": (
        [("/plan", "float64[2] tilt_rad"), ("/LF/limb_reference", "float64[2] gripper_tilt_w_rad")],
        ("/control_input", "float64[28] joint_position_rad"),
    ),
    "15-seven": ([("/control_input", "float64[28] joint_position_rad")], ("/plan", "int32 FORMAT_FEET=5")),
    "16-feet": ([("/plan", "int32 FORMAT_FEET=5"), ("/plan", "int8 FOOTHOLD=2")], None),
}

each = pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)


def definitions(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return {c.topic: summary.schemas[c.schema_id].data.decode() for c in summary.channels.values()}


def test_every_format_is_there() -> None:
    assert {path.stem for path in LOGS} == set(FORMATS)
    for path in LOGS:
        texts = definitions(path)
        has, lacks = FORMATS[path.stem]
        assert all(line in texts[topic].splitlines() for topic, line in has)
        assert lacks is None or lacks[1] not in texts.get(lacks[0], "").splitlines()


def test_the_newest_is_of_todays_format() -> None:
    """A change of a logged message or topic asks for another log_format in msgs/channels.yaml, and a log of it here."""
    newest = max(LOGS, key=lambda path: int(path.stem.split("-")[0]))
    assert read_log(newest).metadata["format"] == str(LOG_FORMAT) == newest.stem.split("-")[0]
    today = {topic: SCHEMAS[channel.type].definition for channel in CHANNELS for topic in log_topics(channel)}
    assert definitions(newest).items() <= today.items()


@each
def test_it_reads_as_another_reader_reads_it(path: Path) -> None:
    log = read_log(path)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        states = {m.log_time: d for _, _, m, d in reader.iter_decoded_messages(topics=["/robot_state"])}
        topics = ["/limb_telemetry", *(f"/{limb}/limb_telemetry" for limb in LIMB_NAMES)]
        limbs = {(m.log_time, d.limb): d for _, _, m, d in reader.iter_decoded_messages(topics=topics)}
    assert len(log.time_s) >= 50
    for row, time_s in enumerate(log.time_s):
        state = states[round(time_s * 1e9)]
        assert log.state["supervisor_state"][row] == state.supervisor_state
        np.testing.assert_array_equal(log.state["body_position_w_m"][row], state.body_position_w_m)
        if log.limbs_fresh[row]:
            for limb in range(4):
                theirs = limbs[round(time_s * 1e9), limb]
                np.testing.assert_array_equal(log.limbs["force_w_n"][row, limb], theirs.force_w_n)
    summary = summarise(log)
    assert summary.scenario == log.plan.scenario_name
    assert {"READY", "CLIMBING"} <= {span.state for span in summary.states}
    assert summary.robot == "scaler"


@each
def test_commands_take_it(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "seen.mcap"
    assert main(["log", "export", str(path), "-o", str(out), "--foxglove"]) == 0
    with out.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = {channel.topic for _, channel, _, _ in reader.iter_decoded_messages()}
    assert {"/tf", "/joint_states", "/markers/wall", "/LF/limb_telemetry"} <= topics
    capsys.readouterr()
    assert main(["log", "info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["climb"]["wall"] == read_log(path).plan.scenario_name
    assert told["damage"] == []
    played = messages(path, -np.inf, np.inf)
    for message in played:
        kind = BY_NAME[message.channel].type
        again = getattr(crux_msgs, kind).decode(message.make())
        if kind == "robot_state_t":
            assert isinstance(again, robot_state_t)
            assert round(again.time_s * 1e9) == message.time_ns
    assert any(message.channel == "CRUX_PLAN" for message in played)


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_the_oldest_has_a_report(tmp_path: Path) -> None:
    written = write_report(LOGS[0], tmp_path / "page.html")
    assert written.kind == "climb"
    assert "walk-flat" in written.file.read_text()
