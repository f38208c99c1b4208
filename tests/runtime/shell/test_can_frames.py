"""CAN frames in the log are those that nodes which are none of ours got and sent; without --log-frames it has none."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import pytest
from crux_contracts import can_codec
from crux_msgs import can_frames_t, command_t
from crux_tools.telemetry.can_frames import CanFrames, read_can_frames
from fake_nodes import JOINTS, LIMBS, FakeNodes, joint_position_rad
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from own_runtime import Starter

CYCLES = 60


def run(start: Starter, *options: str) -> tuple[Path, FakeNodes]:
    runtime = start("--guard-time", "30", *options)
    with FakeNodes(runtime.ports.bus_urls(), CYCLES) as nodes:
        assert nodes.done.wait(600)
        runtime.link.send(command_t.SHUTDOWN)
        status, stderr = runtime.end()
    assert (status, stderr) == (0, "")
    return runtime.log, nodes


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FakeNodes]:
    from contextlib import ExitStack

    with ExitStack() as stack:
        return run(Starter(stack, tmp_path_factory.mktemp("frames")), "--log-frames")


def decoded(frames: CanFrames, direction: int) -> dict[tuple[int, int], list[can_codec.Decoded]]:
    found = defaultdict(list)
    for row in (frames.direction == direction).nonzero()[0]:
        identifier = int(frames.identifier[row])
        payload = frames.payload(row)
        assert int.from_bytes(payload[:2], "little") == can_codec.crc(identifier, payload)
        found[int(frames.bus[row]), identifier].append(can_codec.decode(can_codec.Frame(identifier, payload)))
    return found


def test_what_was_sent_is_what_the_nodes_got(logged: tuple[Path, FakeNodes]) -> None:
    log, nodes = logged
    frames = read_can_frames(log)
    assert frames.cycles.tolist() == list(range(1, CYCLES + 1))
    assert not frames.lost[1:].any()  # in the first cycle late answers to the wake-up may be too many
    sent = decoded(frames, can_frames_t.SENT)
    for key, commands in nodes.commands.items():
        assert [each.values for each in sent[key]] == [each.values for each in commands[: len(sent[key])]]
        assert len(sent[key]) >= (CYCLES if key[1] != 0x20 else 1)
    for limb in range(LIMBS):
        assert [each.values["Cycle"] for each in sent[limb, 0x10]][-CYCLES:] == list(range(1, CYCLES + 1))


def test_what_was_heard_is_what_the_nodes_sent(logged: tuple[Path, FakeNodes]) -> None:
    heard = decoded(read_can_frames(logged[0]), can_frames_t.RECEIVED)
    for limb in range(LIMBS):
        assert (limb, 0x10) not in heard  # the runtime's own frames come back on this bus, and are not logged twice
        for node in JOINTS:
            said = {each.values["CycleEcho"]: each.values["Position_rad"] for each in heard[limb, 0x180 + node]}
            for cycle in range(2, CYCLES + 1):
                assert said[cycle] == joint_position_rad(cycle, limb, node)


def test_times_are_those_of_their_cycles(logged: tuple[Path, FakeNodes]) -> None:
    frames = read_can_frames(logged[0])
    with logged[0].open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        began_ns = {d.cycle: d.wall_ns for *_, d in reader.iter_decoded_messages(topics=["/cycle_timing"])}
    for cycle, host_ns in zip(frames.cycle.tolist(), frames.host_ns.tolist(), strict=True):
        assert began_ns[cycle] < host_ns < began_ns.get(cycle + 1, host_ns + 1)
    assert not frames.stamp_ns.any()  # UDP has none


def test_without_the_option_and_a_fault_there_are_none(start: Starter) -> None:
    assert len(read_can_frames(run(start)[0]).cycle) == 0
