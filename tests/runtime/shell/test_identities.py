"""Who has not told this run of the runtime who he is has no say, and an operator reads who that is."""

from __future__ import annotations

import pytest
from crux_contracts.robot import load_robot
from crux_msgs import command_t, robot_state_t, status_t
from crux_simulation.sim.ports import run_ports
from crux_tools.operator_status import status_json, status_lines
from fake_nodes import FakeNodes
from hand_plan import standing_plan
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from own_runtime import Runtime, Starter
from robot_on_wall import RobotOnWall

CYCLES = 120
PATIENCE_CYCLES = 1500  # after its plan has come, in which a robot without swapped cables is ready


def last_fresh(runtime: Runtime) -> list[int]:
    """joint_fresh of the last cycle in the log, and gripper_fresh."""
    with runtime.log.open("rb") as file:
        *_, last = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
            topics=["/control_input"]
        )
    return [*last[3].joint_fresh, *last[3].gripper_fresh]


def of_seven(status: status_t) -> list[int]:
    """What is wrong with the seven nodes of each limb; the eighth, which this robot does not have, is well."""
    limbs = [status.node_state[8 * limb : 8 * (limb + 1)] for limb in range(4)]
    assert [own[7] for own in limbs] == [status_t.WELL] * 4
    return [state for own in limbs for state in own[:7]]


def run(start: Starter, *swapped: int, hash_: int | None = None) -> tuple[list[int], status_t]:
    """Nodes that were powered before the runtime: they say who they are when they are asked, never else."""
    runtime = start("--guard-time", "30")
    with FakeNodes(runtime.ports.bus_urls(), CYCLES, mute=True, hash_=hash_) as nodes:
        for limb, other in zip(swapped, reversed(swapped), strict=True):
            nodes.limb_of[limb] = other
        assert nodes.done.wait(600)
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
    assert not any(" nodes " in line for line in status_lines(status))


def test_swapped_cables_are_told_and_have_no_say(start: Starter) -> None:
    fresh, status = run(start, 0, 1)
    assert fresh == [0] * 14 + [1] * 14 + [0, 0, 1, 1]
    assert of_seven(status) == [status_t.WRONG_PLACE] * 14 + [status_t.WELL] * 14
    assert any(line.startswith("14 nodes ") and "swapped" in line for line in status_lines(status))


@pytest.mark.parametrize("hash_", [0, int(load_robot("scaler").hash[:8], 16) ^ 1])
def test_nodes_of_another_robot_are_told_and_have_no_say(start: Starter, hash_: int) -> None:
    fresh, status = run(start, hash_=hash_)
    assert set(fresh) == {0}
    assert set(of_seven(status)) == {status_t.WRONG_ROBOT}


def well(runtime: Runtime) -> list[bool]:
    """Of each node, limb by limb; fails where it is neither well nor in another's place."""
    runtime.link.send(command_t.STATUS)
    assert runtime.link.status is not None
    states = of_seven(runtime.link.status)
    assert set(states) <= {status_t.WELL, status_t.WRONG_PLACE}
    return [state == status_t.WELL for state in states]


def states(start: Starter, commands: str, *cables: int) -> tuple[list[bool], list[int]]:
    """Firmware nodes hold a robot where its plan begins, powered before the runtime: who of them is well, and the
    supervisor's state in every cycle."""
    plan = standing_plan()
    with run_ports() as ports, RobotOnWall(ports, plan, cables) as robot:
        runtime = start("--guard-time", "30", "--commands", commands, ports=ports)
        runtime.link.upload(plan)
        robot.await_cycle(robot.cycle + PATIENCE_CYCLES)
        right = well(runtime)
        runtime.link.send(command_t.FORCE_SHUTDOWN)
        assert runtime.end()[0] == 0
    with runtime.log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return right, [state.supervisor_state for *_, state in reader.iter_decoded_messages(topics=["/robot_state"])]


COMMANDS = ["each", pytest.param("broadcast", marks=pytest.mark.sweep)]


@pytest.mark.parametrize("commands", COMMANDS)
def test_a_robot_that_was_there_before_gets_ready(start: Starter, commands: str) -> None:
    right, taken = states(start, commands, 0, 1, 2, 3)
    assert all(right)
    assert robot_state_t.READY in taken


@pytest.mark.parametrize("commands", COMMANDS)
def test_swapped_cables_never_get_ready(start: Starter, commands: str) -> None:
    right, taken = states(start, commands, 1, 0, 2, 3)
    assert right == [False] * 14 + [True] * 14
    assert set(taken) == {robot_state_t.IDLE}
