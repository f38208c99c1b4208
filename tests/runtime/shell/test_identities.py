"""Who has not told this run of the runtime who he is has no say, and an operator reads who that is."""

from __future__ import annotations

import pytest
from crux_contracts.robot import load_robot
from crux_msgs import command_t, status_t
from crux_tools.operator_status import status_json, status_lines
from fake_nodes import FakeNodes
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from own_runtime import Runtime, Starter

CYCLES = 120


def last_fresh(runtime: Runtime) -> list[int]:
    """joint_fresh of the last cycle in the log, and gripper_fresh."""
    with runtime.log.open("rb") as file:
        *_, last = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/control_input"]
        )
    return [*last[3].joint_fresh, *last[3].gripper_fresh]


def run(start: Starter, *swapped: int, hash_: int | None = None) -> tuple[list[int], status_t]:
    """Nodes that were powered before the runtime: they say who they are when they are asked, never else."""
    runtime = start("--guard-time", "30")
    with FakeNodes(runtime.ports.bus_urls(), CYCLES, mute=True, hash_=hash_) as nodes:
        for limb, other in zip(swapped, reversed(swapped), strict=True):
            nodes.limb_of[limb] = other
        assert nodes.done.wait(30)
        answer = runtime.link.send(command_t.STATUS)
        status = runtime.link.status
        assert status is not None
        assert status_json(answer, status)["state"] == "idle"
        runtime.link.send(command_t.SHUTDOWN)
        assert runtime.end()[0] == 0
    return last_fresh(runtime), status


def test_nodes_that_were_there_before_are_asked_who_they_are(start: Starter) -> None:
    fresh, status = run(start)
    assert set(fresh) == {1}
    assert set(status.node_state) == {status_t.WELL}
    assert status_lines(status) == []


def test_swapped_cables_are_told_and_have_no_say(start: Starter) -> None:
    fresh, status = run(start, 0, 1)
    assert fresh == [0] * 12 + [1] * 12 + [0, 0, 1, 1]
    assert list(status.node_state) == [status_t.WRONG_PLACE] * 14 + [status_t.WELL] * 14
    assert "swapped" in status_lines(status)[0]


@pytest.mark.parametrize("hash_", [0, int(load_robot("scaler").hash[:8], 16) ^ 1])
def test_nodes_of_another_robot_are_told_and_have_no_say(start: Starter, hash_: int) -> None:
    fresh, status = run(start, hash_=hash_)
    assert set(fresh) == {0}
    assert set(status.node_state) == {status_t.WRONG_ROBOT}
