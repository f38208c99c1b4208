"""The runtime in lockstep with nodes that are none of ours: what it sends and logs, and that it does so twice alike."""

from __future__ import annotations

import signal
import socket
import subprocess
import time
from collections import defaultdict
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from crux_contracts import can_codec
from crux_msgs import command_t
from crux_tools.paths import built
from crux_tools.telemetry import read_channels
from fake_nodes import GRIPPER, JOINTS, LIMBS, SLOTS, FakeNodes, finger_force_N, joint_position_rad
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from own_runtime import ROBOT, Runtime, Starter, rerun_info
from rosbags.highlevel import AnyReader

CYCLES = 120
LIMB_EVERY = 10  # log_every of the limb channels in msgs/channels.yaml
HEALTH_EVERY = 50  # and of the buses
PERIOD_NS = 2_000_000


def run_cycles(start: Starter) -> tuple[Runtime, FakeNodes, str]:
    """A run in which the nodes answer CYCLES cycles and are then silent, ended by SHUTDOWN."""
    runtime = start("--guard-time", "30", "--tag", "seed=7", "--tag", "why=a = b")
    with FakeNodes(runtime.ports.bus_urls(), CYCLES) as nodes:
        assert nodes.done.wait(600)
        runtime.link.send(command_t.SHUTDOWN)
        status, stderr = runtime.end()
    assert status == 0, stderr
    return runtime, nodes, stderr


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FakeNodes, str]:
    """One such run for all the tests that only look at it."""
    from contextlib import ExitStack

    with ExitStack() as stack:
        runtime, nodes, stderr = run_cycles(Starter(stack, tmp_path_factory.mktemp("log")))
        return runtime.log, nodes, stderr


Finished = tuple[Path, FakeNodes, str]


def test_says_nothing_when_all_is_well(finished: Finished) -> None:
    assert finished[2] == ""


def test_log_holds_what_the_nodes_said(finished: Finished) -> None:
    inputs = []
    with finished[0].open("rb") as file:
        for _, _, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/control_input"]
        ):
            assert message.log_time == decoded.cycle * PERIOD_NS
            inputs.append(decoded)
    assert [i.cycle for i in inputs] == list(range(1, CYCLES + 1))
    for given in inputs:
        echoed = given.cycle - 1
        assert set(given.joint_fresh) == set(given.gripper_fresh) == set(given.ft_fresh) == {1}
        for limb in range(LIMBS):
            for node in JOINTS:
                joint = SLOTS * limb + node - 1
                assert given.joint_position_rad[joint] == joint_position_rad(echoed, limb, node)
                assert given.joint_velocity_rad_s[joint] == pytest.approx(-0.5, abs=1e-6)
            assert given.finger_force_n[limb] == pytest.approx(finger_force_N(echoed, limb), abs=1e-4)
            assert given.ft_force_g_n[3 * limb] == pytest.approx(1.25, abs=1e-6)
            assert given.ft_moment_g_nm[3 * limb + 2] == pytest.approx(-0.5, abs=1e-6)


def test_nodes_get_what_the_log_says(finished: Finished) -> None:
    log, nodes, _ = finished
    assert nodes.bad_commands == 0
    outputs = []
    with log.open("rb") as file:
        for *_, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/control_output"]
        ):
            outputs.append(decoded)
    for limb in range(LIMBS):
        for node in JOINTS:
            commands = nodes.commands[limb, 0x100 + node]
            assert len(commands) >= CYCLES
            for output, command in zip(outputs, commands, strict=False):
                joint = SLOTS * limb + node - 1
                assert command.values["Mode"] == output.joint_mode[joint]
                assert command.values["Position_rad"] == pytest.approx(output.joint_position_rad[joint], abs=1e-6)
                assert command.values["Torque_Nm"] == pytest.approx(output.joint_torque_nm[joint], abs=6e-4)
                assert float(command.values["Kp_Nm_rad"]) > 0
        grips = nodes.commands[limb, 0x100 + GRIPPER]
        for output, grip in zip(outputs, grips, strict=False):
            assert grip.values["Opening_m"] == pytest.approx(output.finger_opening_m[limb], abs=1e-6)


def test_host_heartbeat_comes_by_cycle_count(finished: Finished) -> None:
    for limb in range(LIMBS):
        beats = [beat.values["Uptime_ms"] for beat in finished[1].commands[limb, 0x20]]
        assert beats == [2, 100, 200]  # the first state, then every 50 cycles


def of_each_limb(topic: str) -> list[str]:
    return [f"/{limb}/{topic}" for limb in ("LF", "RF", "LR", "RR")]


def test_each_limb_is_on_its_own_topics(finished: Finished) -> None:
    with AnyReader([finished[0]]) as reader:
        for topic in ("limb_reference", "limb_telemetry", "bus_health"):
            for limb, name in enumerate(of_each_limb(topic)):
                (connection,) = [c for c in reader.connections if c.topic == name]
                told = [reader.deserialize(raw, connection.msgtype) for *_, raw in reader.messages([connection])]
                assert {message.limb for message in told} == {limb}  # type: ignore[attr-defined]


def test_order_of_messages_is_fixed(finished: Finished) -> None:
    by_time: dict[int, list[str]] = defaultdict(list)
    with finished[0].open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            by_time[message.log_time].append(channel.topic)
    for cycle in range(1, CYCLES + 1):
        limbs = (cycle - 1) % LIMB_EVERY == 0
        expected = ["/control_input", "/control_output", "/robot_state"]
        expected += of_each_limb("limb_reference") + of_each_limb("limb_telemetry") if limbs else []
        expected += of_each_limb("bus_health") if (cycle - 1) % HEALTH_EVERY == 0 else []
        expected += ["/cycle_timing"]
        expected += ["/command", "/acknowledgement"] if cycle == CYCLES else []  # SHUTDOWN
        assert by_time[cycle * PERIOD_NS] == expected


def test_metadata_names_robot_pace_and_end(finished: Finished) -> None:
    from crux_contracts.robot import load_robot

    with finished[0].open("rb") as file:
        metadata, tags, end = make_reader(file).iter_metadata()
    assert (metadata.name, tags.name, end.name) == ("crux", "crux_tags", "crux_end")
    assert end.metadata == {
        "cycles": str(CYCLES + 1),  # the last one was not answered and is not in the log
        "unanswered": "0",
        "missed_deadlines": "0",
        "dropped_records": "0",
    }
    assert metadata.metadata["robot_sha256"] == load_robot("scaler").hash
    assert metadata.metadata["pace"] == "bus"
    assert metadata.metadata["version"]
    assert tags.metadata == {"seed": "7", "why": "a = b"}


def test_metadata_tells_when_where_and_by_what(finished: Finished) -> None:
    from crux_commit import COMMIT

    said = read_channels(finished[0]).metadata
    assert timedelta(0) < datetime.now(UTC) - datetime.fromisoformat(said["started_utc"]) < timedelta(hours=1)
    before_ns, utc_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
    offset_ns, play_ns = int(said["utc_minus_monotonic_ns"]), 10_000_000
    assert utc_ns - after_ns - play_ns < offset_ns < utc_ns - before_ns + play_ns
    assert said["host"] == socket.gethostname()
    assert said["commit"] == COMMIT
    assert "--pace bus" in said["command_line"]


def test_the_robot_description_is_attached(finished: Finished) -> None:
    with finished[0].open("rb") as file:
        attached = {attachment.name: attachment.data for attachment in make_reader(file).iter_attachments()}
    assert attached == {name: (ROBOT / name).read_bytes() for name in ("robot.yaml", "scaler.urdf")}


def test_a_log_that_is_there_stays(start: Starter, tmp_path: Path) -> None:
    log, second, third = (tmp_path / name for name in ("climb.mcap", "climb-2.mcap", "climb-3.mcap"))
    log.write_text("evidence")
    for free in (second, third):
        runtime = start("--log", str(log))
        runtime.process.send_signal(signal.SIGTERM)
        status, stderr = runtime.end()
        assert status == 0
        assert stderr == f"crux-runtime: {log} is there already and stays as it is; this log is {free}\n"
        assert read_channels(free).metadata["robot"] == "scaler"
    assert log.read_text() == "evidence"


def test_a_log_is_replaced_where_told_so(start: Starter, tmp_path: Path) -> None:
    log = tmp_path / "climb.mcap"
    log.write_text("evidence")
    runtime = start("--log", str(log), "--overwrite")
    runtime.process.send_signal(signal.SIGTERM)
    assert runtime.end() == (0, "")
    assert read_channels(log).metadata["robot"] == "scaler"
    assert [path.name for path in tmp_path.glob("climb*")] == ["climb.mcap"]


@pytest.mark.parametrize("more", [(), ("--overwrite",)])
def test_what_is_no_file_is_no_log(more: tuple[str, ...], tmp_path: Path) -> None:
    for wrong in (tmp_path, Path("/dev/full")):
        command = [str(built("runtime/app/crux-runtime")), "--insecure", "--robot", str(ROBOT), "--log", str(wrong)]
        command += ["--pace", "bus", *more]
        ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
        assert ended.returncode == 2
        assert ended.stderr == f"crux-runtime: log {wrong}: is no file that a log can be written to\n"


def test_log_opens_in_other_readers(finished: Finished) -> None:
    with AnyReader([finished[0]]) as reader:
        (connection,) = [c for c in reader.connections if c.topic == "/robot_state"]
        states = [reader.deserialize(raw, connection.msgtype) for _, _, raw in reader.messages([connection])]
    assert [s.cycle for s in states] == list(range(1, CYCLES + 1))  # type: ignore[attr-defined]
    assert "/LF/limb_telemetry" in rerun_info(finished[0])


def messages(log: Path) -> list[tuple[str, int, int, bytes]]:
    with log.open("rb") as file:
        return [
            (channel.topic, message.sequence, message.log_time, message.data)
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False)
            if channel.topic != "/cycle_timing"
        ]


def test_two_runs_log_the_same(finished: Finished, start: Starter) -> None:
    assert messages(run_cycles(start)[0].log) == messages(finished[0])


@pytest.mark.alone
def test_a_silent_node_costs_the_guard_time_and_is_counted(start: Starter) -> None:
    runtime = start("--guard-time", "0.5")  # long, so that a busy machine makes no other node late
    with FakeNodes(runtime.ports.bus_urls(), 10_000, deaf=(2, 3)) as nodes:
        nodes.await_cycle(6)
        runtime.process.send_signal(signal.SIGTERM)
        status, stderr = runtime.end()
    assert status == 0
    assert "not answered by all nodes within the guard time" in stderr
    with runtime.log.open("rb") as file:
        decoded = [
            d
            for *_, d in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
                topics=["/control_input"]
            )
        ]
    assert len(decoded) >= 5
    for given in decoded[1:]:
        assert [i for i, fresh in enumerate(given.joint_fresh) if not fresh] == [SLOTS * 2 + 2]


def test_sigterm_ends_with_a_hold_and_a_whole_log_of_late_nodes_too(start: Starter) -> None:
    runtime = start()
    with FakeNodes(runtime.ports.bus_urls(), 10_000) as nodes:
        nodes.await_cycle(20)
        nodes.late_s = 0.25
        runtime.process.send_signal(signal.SIGTERM)
        status, stderr = runtime.end()
    assert (status, stderr) == (0, "")
    with runtime.log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        commands = [d.operator_command for *_, d in reader.iter_decoded_messages(topics=["/control_input"])]
    assert set(commands[-10:]) == {command_t.HOLD}
    assert set(commands[:-10]) == {command_t.NONE}


def test_damaged_statuses_are_counted_and_not_used(start: Starter) -> None:
    runtime = start("--guard-time", "30")
    real = can_codec.encode

    def damaging(name: str, values: can_codec.Values, counter: int = 0, node: int | None = None) -> can_codec.Frame:
        frame = real(name, values, counter, node)
        if name == "JointStatus" and node == 4 and values["CycleEcho"] == 5:
            bad = bytearray(frame.data)
            bad[5] ^= 0x10
            return can_codec.Frame(frame.identifier, bytes(bad))
        return frame

    with pytest.MonkeyPatch.context() as patch, FakeNodes(runtime.ports.bus_urls(), 5) as nodes:
        patch.setattr(can_codec, "encode", damaging)
        nodes.await_cycle(5)
        runtime.link.send(command_t.SHUTDOWN)
        status, stderr = runtime.end()
    assert status == 0
    assert "4 frames with a wrong CRC" in stderr
    with runtime.log.open("rb") as file:
        cycles = [m.log_time for _, _, m in make_reader(file).iter_messages(topics=["/control_input"])]
    assert cycles == [n * PERIOD_NS for n in range(1, 5)]  # the fifth was never fully answered
