"""The 32 nodes over real multicast sockets, with python-can and cantools on the other side."""

from __future__ import annotations

from collections.abc import Iterator

import can
import crux_nodes
import numpy as np
import pytest
from crux_contracts import can_codec
from crux_contracts.robot import Robot, load_robot
from crux_tools.paths import built
from host import HOLD, LIBRARY, REARM, TRACK, Host, host
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

JOINT: can_codec.Values = {"Mode": TRACK, "Position_rad": 0.5, "Torque_Nm": 1.0, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 4.0}
GRIPPER: can_codec.Values = {"Mode": TRACK, "Opening_m": 0.029, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 30.0}
STATES = {"BOOT": 0, "HOLD": 1, "TRACK": 2, "DECELERATE": 3, "FAULT": 4}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@pytest.fixture
def bench(robot: Robot) -> Iterator[Host]:
    with host(robot) as made:
        yield made


@pytest.fixture(scope="module")
def tracking(robot: Robot) -> Iterator[Host]:
    with host(robot) as made:
        made.run(0, JOINT, GRIPPER)
        yield made


def test_nodes_introduce_themselves(bench: Host, robot: Robot) -> None:
    bench.run(0, JOINT, GRIPPER)
    for limb in range(crux_nodes.LIMBS):
        heard = bench.heard(limb)
        for node in range(1, crux_nodes.NODES_PER_LIMB + 1):
            kind = "Gripper" if node == can_codec.GRIPPER_NODE else "Joint"
            (identity,) = heard[f"{kind}Identity", node]
            assert identity["Protocol"] == can_codec.database().dbc.attributes["ProtocolVersion"].value  # type: ignore[union-attr]
            assert (identity["NodeKind"], identity["NodeId"], identity["Limb"]) == (
                1 if kind == "Joint" else 2,
                node,
                limb,
            )
            assert identity["ParameterHash"] == int(robot.hash[:8], 16)
            (emergency,) = heard[f"{kind}Emergency", node]
            assert emergency["Cause"] == 9  # RESTARTED


def test_every_node_answers_every_cycle(bench: Host) -> None:
    for cycle in range(60):
        bench.run(cycle, JOINT, GRIPPER)
        for limb in range(crux_nodes.LIMBS):
            heard = bench.heard(limb)
            answers = [("JointStatus", node) for node in can_codec.JOINT_NODES] + [
                ("GripperStatus", 7),
                ("ForceTorque", 7),
            ]
            assert {key: [v["CycleEcho"] for v in heard[key]] for key in answers} == {key: [cycle] for key in answers}
            assert {v["Counter"] for key in answers for v in heard[key]} == {cycle}


ROBOT = load_robot("scaler")
FINITE = st.floats(allow_nan=False, allow_infinity=False, width=32)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_status_carries_what_the_plant_measured(tracking: Host, data: st.DataObject) -> None:
    """Physical value → node → CAN → cantools: right to half a step of the signal, saturated at its ends."""

    def draw(size: int, high: float) -> crux_nodes.Array:
        numbers = st.floats(-high, high) | FINITE
        return np.array(data.draw(st.lists(numbers, min_size=size, max_size=size)))

    def draw_sensible(lower: crux_nodes.Array, upper: crux_nodes.Array) -> crux_nodes.Array:
        """Anything that is not so far off that the sensor must be broken."""
        shares = data.draw(st.lists(st.floats(-0.99, 1.99), min_size=len(lower), max_size=len(lower)))
        return lower + np.array(shares) * (upper - lower)

    joints = crux_nodes.joint_parameters(ROBOT)
    fastest = np.array([joint.velocity_limit_rad_s for joint in joints])
    opening = np.tile(ROBOT.gripper.opening_m, (4, 1))
    plant = tracking.plant
    plant.joint_position_rad = draw_sensible(
        np.array([joint.position_min_rad for joint in joints]), np.array([joint.position_max_rad for joint in joints])
    )
    plant.joint_velocity_rad_s = draw_sensible(-30 * fastest, 30 * fastest)
    plant.joint_torque_Nm = draw(crux_nodes.JOINTS, 40.0)
    plant.finger_opening_m = draw_sensible(opening[:, 0], opening[:, 1])
    plant.finger_speed_m_s = draw_sensible(np.full(4, -0.4), np.full(4, 0.4))
    plant.finger_force_N = draw(4, 400.0)
    plant.ft_wrench = draw(24, 20.0).reshape(4, 6)
    tracking.heard(2)
    tracking.run(7, JOINT, GRIPPER)
    limb = 2
    heard = tracking.heard(limb)
    for slot, node in enumerate(can_codec.JOINT_NODES):
        (status,) = heard["JointStatus", node]
        joint = limb * len(can_codec.JOINT_NODES) + slot
        assert status["Position_rad"] == np.float32(plant.joint_position_rad[joint])
        assert status["Velocity_rad_s"] == nearest("JointStatus", "Velocity_rad_s", plant.joint_velocity_rad_s[joint])
        assert status["Torque_Nm"] == nearest("JointStatus", "Torque_Nm", plant.joint_torque_Nm[joint])
        assert status["Temperature_degC"] == 25
        assert status["State"] == STATES["TRACK"]
    (gripper,) = heard["GripperStatus", 7]
    assert gripper["Opening_m"] == np.float32(plant.finger_opening_m[limb])
    assert gripper["Speed_m_s"] == nearest("GripperStatus", "Speed_m_s", plant.finger_speed_m_s[limb])
    assert gripper["Force_N"] == nearest("GripperStatus", "Force_N", plant.finger_force_N[limb])
    (sample,) = heard["ForceTorque", 7]
    names = ["ForceX_N", "ForceY_N", "ForceZ_N", "MomentX_Nm", "MomentY_Nm", "MomentZ_Nm"]
    wrench = plant.ft_wrench[limb]
    for name, value in zip(names, wrench, strict=True):
        assert sample[name] == nearest("ForceTorque", name, value)
    assert sample["Status"] == int(bool(np.any(np.abs(wrench[:3]) > 200) or np.any(np.abs(wrench[3:]) > 8)))


def nearest(message: str, name: str, value: float) -> object:
    signal = can_codec.message(message, 1).get_signal_by_name(name)
    scale = float(signal.scale)
    bound = 1 << (signal.length - 1)
    clipped = min(max(value, -bound * scale), (bound - 1) * scale)
    return pytest.approx(clipped, abs=0.502 * scale)


def test_joint_layouts_serve_grippers_too() -> None:
    """The core writes a gripper's emergency, heartbeat and identity with the joint's functions."""
    for kind in ("Emergency", "Heartbeat", "Identity"):
        joint, gripper = can_codec.message(f"Joint{kind}", 1), can_codec.message(f"Gripper{kind}")
        assert gripper.frame_id - joint.frame_id == 6
        assert joint.length == gripper.length
        layouts = [[(s.name, s.start, s.length, s.is_signed, s.choices) for s in m.signals] for m in (joint, gripper)]
        assert layouts[0] == layouts[1]


def test_torque_is_the_pd_law(bench: Host) -> None:
    bench.plant.joint_position_rad[:] = 0.49
    bench.plant.joint_velocity_rad_s[:] = 0.1
    for cycle in range(300):
        torque, force = bench.run(cycle, JOINT, GRIPPER)
    np.testing.assert_allclose(torque, 100 * 0.01 - 4 * 0.1 + 1.0, atol=1e-3)
    np.testing.assert_allclose(force, 20000 * 0.001, atol=0.05)


def test_a_host_that_dies_leaves_a_robot_that_holds_on(bench: Host, robot: Robot) -> None:
    for cycle in range(300):
        torque, force = bench.run(cycle, JOINT, GRIPPER)
    for missed in range(1, 2000):
        held_torque, held_force = bench.control()
        bench.publish()
        joints, faults, grippers, _ = bench.nodes.states()
        latched = missed >= robot.can.watchdog_cycles
        assert set(faults) == {int(latched)}
        assert (STATES["TRACK"] in joints) == (STATES["TRACK"] in grippers) == (not latched)
        np.testing.assert_allclose(held_torque, torque, atol=1e-3)
        np.testing.assert_allclose(held_force, force, atol=1e-3)
        if missed % 50 == 0:
            for limb in range(crux_nodes.LIMBS):
                heard = bench.heard(limb)
                # A heartbeat a node every 100 ms, and no status without a Sync.
                assert not any(name.endswith("Status") for name, _ in heard) or missed == 50
    # A new host with counters of its own, on the same buses.
    bench._counters.clear()
    bench.run(0, JOINT, GRIPPER)
    assert set(bench.nodes.states()[0]) == {STATES["HOLD"]}
    bench.run(1, JOINT | {"Mode": REARM}, GRIPPER | {"Mode": REARM})
    bench.run(2, JOINT, GRIPPER)
    assert set(bench.nodes.states()[0]) == {STATES["TRACK"]}
    assert set(bench.nodes.states()[1]) == {0}


def test_heartbeats_are_ten_a_second(bench: Host) -> None:
    beats = 0
    for _ in range(500):  # one second
        bench.control()
        bench.publish()
        beats += sum(len(v) for (name, _), v in bench.heard(1).items() if name.endswith("Heartbeat"))
    assert beats == pytest.approx(10 * crux_nodes.NODES_PER_LIMB, abs=crux_nodes.NODES_PER_LIMB)


def test_a_cycle_waits_for_all_buses(bench: Host) -> None:
    for limb in range(3):
        bench.send(limb, "Sync", {"Cycle": 5})
    assert bench.nodes.wait_sync(0.05) is None
    bench.send(3, "Sync", {"Cycle": 4})
    assert bench.nodes.wait_sync(0.05) is None, "another cycle"
    bench.send(3, "Sync", {"Cycle": 5})
    assert bench.nodes.wait_sync(2.0) == 5
    assert bench.nodes.wait_sync(0.01) is None, "each Sync counts once"


def test_cycle_zero_is_answered_as_often_as_it_is_sent(bench: Host) -> None:
    for _ in range(3):
        for limb in range(crux_nodes.LIMBS):
            bench.send(limb, "Sync", {"Cycle": 0})
        assert bench.nodes.wait_sync(2.0) == 0
        bench.publish()
        assert [v["CycleEcho"] for v in bench.heard(3)["JointStatus", 6]] == [0]
    bench.run(1, JOINT, GRIPPER)
    assert set(bench.nodes.states()[0]) == {STATES["TRACK"]}


def test_host_state_is_the_last_whole_heartbeat(bench: Host) -> None:
    assert bench.nodes.host_state() == crux_nodes.NO_HOST_STATE
    bench.send(0, "HostHeartbeat", {"HostState": 0x13})
    bench.run(0, JOINT, GRIPPER)
    assert bench.nodes.host_state() == 0x13
    frame = can_codec.encode("HostHeartbeat", {"HostState": 2}, 9)
    bench.send_raw(0, frame.identifier, frame.data[:-1] + b"\x01")
    bench.run(1, JOINT, GRIPPER)
    assert bench.nodes.host_state() == 0x13, "damaged"
    bench.send(1, "HostHeartbeat", {"HostState": 3})
    bench.run(2, JOINT, GRIPPER)
    assert bench.nodes.host_state() == 3, "every bus carries it"


def test_injected_faults_hit_one_node_alone(bench: Host) -> None:
    cycle = 0
    for cycle in range(20):
        bench.run(cycle, JOINT, GRIPPER)
    bench.heard(1)
    bench.nodes.drop_sent(1, 4, 1)
    bench.run(cycle + 1, JOINT, GRIPPER)
    heard = bench.heard(1)
    assert ("JointStatus", 4) not in heard
    assert ("JointStatus", 3) in heard
    bench.nodes.corrupt_received(1, 2, 2)
    bench.run(cycle + 2, JOINT, GRIPPER)
    assert bench.nodes.counters(1, 2).rejected_crc == 2
    assert ("JointStatus", 2) not in bench.heard(1), "no answer without a valid Sync"
    bench.nodes.drop_received(1, 7, 1000)
    for n in range(3, 10):
        bench.run(cycle + n, JOINT, GRIPPER)
    joints, faults, grippers, gripper_faults = bench.nodes.states()
    assert set(joints) == {STATES["TRACK"]}
    assert set(faults) == {0}
    assert list(grippers) == [2, 1, 2, 2]
    assert list(gripper_faults) == [0, 1, 0, 0]
    bench.nodes.set_temperature(3, 6, 95.0)
    bench.nodes.reset(0, 1)
    bench.heard(0)
    bench.run(cycle + 10, JOINT, GRIPPER)
    assert bench.nodes.states()[1][3 * len(can_codec.JOINT_NODES) + 5] == 0x20
    heard = bench.heard(0)
    assert heard["JointEmergency", 1][0]["Cause"] == 9
    assert bench.nodes.states()[0][0] == STATES["TRACK"]


def test_foreign_traffic_is_harmless(bench: Host) -> None:
    bench.run(0, JOINT, GRIPPER)
    rng = np.random.default_rng(3)
    for _ in range(300):
        bench.send_raw(0, int(rng.integers(0, 0x800)), rng.bytes(int(rng.choice([0, 1, 8, 16, 20, 64]))))
        bench.buses[0].send(can.Message(arbitration_id=0x101, data=b"\1" * 8, is_extended_id=True))
        bench.buses[0].send(can.Message(arbitration_id=0x10, is_extended_id=False, is_remote_frame=True))
    torque, _ = bench.run(1, JOINT, GRIPPER)
    assert np.all(torque == torque[0]), "the bus with the noise does as the others"
    assert set(bench.nodes.states()[0]) == {STATES["TRACK"]}


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("udp:239.74.163.2", "GROUP:PORT"),
        ("udp:10.0.0.1:5000", "not a multicast"),
        ("udp:239.74.163.2:70000", "port"),
        ("serial:1", "unknown kind of bus"),
        ("socketcan:nosuchcan0", "no such interface"),
        ("", "unknown kind of bus"),
    ],
)
def test_a_wrong_bus_is_named(robot: Robot, url: str, words: str) -> None:
    urls = ["udp:239.74.163.2:19990", url, "udp:239.74.163.2:19991", "udp:239.74.163.2:19992"]
    joints, grippers = crux_nodes.joint_parameters(robot), crux_nodes.gripper_parameters(robot)
    with pytest.raises(crux_nodes.NodesError, match=words) as caught:
        crux_nodes.Nodes(built(LIBRARY), urls, joints, grippers)
    assert url in str(caught.value)


def test_wrong_parameters_are_named(robot: Robot) -> None:
    joints, grippers = crux_nodes.joint_parameters(robot), crux_nodes.gripper_parameters(robot)
    joints[9].torque_limit_Nm = float("nan")
    with pytest.raises(crux_nodes.NodesError, match="joint 3 of limb 1: torque_limit_Nm"):
        crux_nodes.Nodes(built(LIBRARY), ["udp:239.74.163.2:19990"] * 4, joints, grippers)


def test_a_node_that_does_not_exist_is_named(bench: Host) -> None:
    with pytest.raises(crux_nodes.NodesError, match="no node 9 on limb 0"):
        bench.nodes.drop_sent(0, 9, 1)


def test_hold_commands_keep_torque_and_squeeze(bench: Host) -> None:
    for cycle in range(300):
        torque, force = bench.run(cycle, JOINT, GRIPPER)
    for cycle in range(300, 350):
        held, squeeze = bench.run(cycle, {"Mode": HOLD}, {"Mode": HOLD, "Opening_m": 0.06})
        np.testing.assert_allclose(held, torque, atol=1e-3)
        np.testing.assert_allclose(squeeze, force, atol=1e-3)
