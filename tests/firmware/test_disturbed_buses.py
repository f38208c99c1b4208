"""What the bench can do to a limb's bus: lose frames, take it away, put a stranger's frames on it."""

from __future__ import annotations

from collections.abc import Iterator

import crux_nodes
import pytest
from crux_contracts import can_codec
from crux_contracts.robot import load_robot
from host import HOLD, TRACK, Host, host

JOINT: can_codec.Values = {"Mode": TRACK, "Position_rad": 0.0, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 2.0}
GRIPPER: can_codec.Values = {"Mode": TRACK, "Opening_m": 0.029, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 30.0}
CYCLES = 300
LIMB, JOINTS = 2, len(can_codec.JOINT_NODES)
BUS_OFF = 7  # cause of an emergency


@pytest.fixture
def bench() -> Iterator[Host]:
    with host(load_robot("scaler")) as made:
        yield made


def statuses(bench: Host, limb: int) -> list[int]:
    """Statuses of the limb's joints since the last call."""
    heard = bench.heard(limb)
    return [len(heard["JointStatus", node]) for node in can_codec.JOINT_NODES]


def test_a_share_of_one_cuts_the_limb_and_zero_mends_it(bench: Host) -> None:
    bench.run(0, JOINT, GRIPPER)
    bench.heard(LIMB)
    bench.nodes.lose(LIMB, 1.0)
    for cycle in range(1, 121):
        bench.run(cycle, JOINT, GRIPPER)
    assert statuses(bench, LIMB) == [0] * JOINTS
    joints = bench.nodes.states()[0]
    assert set(joints[JOINTS * LIMB : JOINTS * (LIMB + 1)]) == {HOLD + 1}, "the watchdog stopped them"
    assert set(joints[: JOINTS * LIMB]) == {TRACK + 1}, "other limbs go on"
    bench.nodes.lose(LIMB, 0.0)
    bench.run(121, JOINT, GRIPPER)
    assert statuses(bench, LIMB) == [1] * JOINTS


@pytest.mark.parametrize("node", [3, 7])
def test_a_node_whose_controller_is_off_the_bus_holds_and_says_so_afterwards(bench: Host, node: int) -> None:
    kind = "Gripper" if node == 7 else "Joint"
    for cycle in range(10):
        bench.run(cycle, JOINT, GRIPPER)
    bench.heard(LIMB)
    bench.nodes.disturb(LIMB, node, True)
    for cycle in range(10, 110):
        bench.run(cycle, JOINT, GRIPPER)
        heard = bench.heard(LIMB)
        answered = {n for (name, n), rows in heard.items() if name.endswith("Status") and rows}
        assert answered == {*can_codec.JOINT_NODES, can_codec.GRIPPER_NODE} - {node}
    assert joint_and_gripper_states(bench)[node - 1] == HOLD + 1
    bench.nodes.disturb(LIMB, node, False)
    bench.run(110, JOINT, GRIPPER)
    heard = bench.heard(LIMB)
    assert heard[f"{kind}Status", node][-1]["State"] == HOLD + 1, "latched"
    assert BUS_OFF in {int(row["Cause"]) for row in heard[f"{kind}Emergency", node]}


def joint_and_gripper_states(bench: Host) -> bytes:
    """Of the limb's eight nodes."""
    joints, _, grippers, _ = bench.nodes.states()
    own = joints[JOINTS * LIMB : JOINTS * (LIMB + 1)]
    return own[: can_codec.GRIPPER_NODE - 1] + grippers[LIMB : LIMB + 1] + own[can_codec.GRIPPER_NODE - 1 :]


def answered_with_loss(share: float, seed: int) -> list[int]:
    """Statuses that got through in CYCLES cycles on a fresh robot."""
    answered = [0] * JOINTS
    with host(load_robot("scaler")) as bench:
        bench.nodes.lose(LIMB, share, seed)
        for cycle in range(CYCLES):
            bench.run(cycle, {**JOINT, "Mode": HOLD}, GRIPPER)
            answered = [sum(pair) for pair in zip(answered, statuses(bench, LIMB), strict=True)]
    return answered


def test_a_share_is_lost_both_ways_and_the_same_frames_for_the_same_seed() -> None:
    share = 0.3
    first = answered_with_loss(share, 7)
    assert first == answered_with_loss(share, 7) != answered_with_loss(share, 8)
    # Once in (Sync) and once out (status).
    assert sum(first) / JOINTS / CYCLES == pytest.approx((1 - share) ** 2, abs=0.05)


def test_a_bus_that_is_away_is_neither_waited_for_nor_sent_on(bench: Host) -> None:
    bench.run(0, JOINT, GRIPPER)
    bench.heard(LIMB)
    bench.nodes.connect(LIMB, False)
    for limb in range(crux_nodes.LIMBS):
        if limb != LIMB:
            bench.send(limb, "Sync", {"Cycle": 1})
    assert bench.nodes.wait_sync(2.0) == 1
    bench.control()
    bench.publish()
    assert statuses(bench, LIMB) == [0] * JOINTS
    bench.nodes.connect(LIMB, True)
    assert bench.nodes.wait_sync(0.01) is None
    bench.run(2, JOINT, GRIPPER)
    assert statuses(bench, LIMB) == [1] * JOINTS


def test_a_rogue_hosts_frame_reaches_the_nodes_and_the_bus(bench: Host) -> None:
    bench.run(0, JOINT, GRIPPER)
    forged = can_codec.encode("JointCommand", {**JOINT, "Position_rad": 0.5}, 2, 3)
    bench.nodes.intrude(LIMB, forged.identifier, forged.data)
    assert bench.nodes.counters(LIMB, 3).commands == 2
    assert bench.nodes.counters(LIMB, 4).commands == 1
    heard = []
    while (message := bench.buses[LIMB].recv(timeout=0.1)) is not None:
        heard.append(message.arbitration_id)
    assert heard[-1] == forged.identifier
    bad = bytearray(forged.data)
    bad[5] ^= 1
    bench.nodes.intrude(LIMB, forged.identifier, bytes(bad))
    assert bench.nodes.counters(LIMB, 3).rejected_crc == 1
    with pytest.raises(crux_nodes.NodesError):
        bench.nodes.intrude(4, forged.identifier, forged.data)
