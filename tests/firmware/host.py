"""A host made for tests: python-can buses (udp_multicast), frames by cantools, and the 28 nodes to talk to."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import can
import crux_nodes
import numpy as np
from crux_contracts import can_codec
from crux_contracts.robot import Robot
from crux_simulation.sim.ports import BUS_GROUP, run_ports
from crux_tools.paths import built

LIBRARY = "firmware/libcrux_nodes.so"
LIMBS = crux_nodes.LIMBS
HOLD, TRACK, REARM = 0, 1, 2


@dataclass
class Plant:
    """Measurements as a test wants them."""

    joint_position_rad: crux_nodes.Array = field(default_factory=lambda: np.zeros(crux_nodes.JOINTS))
    joint_velocity_rad_s: crux_nodes.Array = field(default_factory=lambda: np.zeros(crux_nodes.JOINTS))
    joint_torque_Nm: crux_nodes.Array = field(default_factory=lambda: np.zeros(crux_nodes.JOINTS))
    finger_opening_m: crux_nodes.Array = field(default_factory=lambda: np.full(LIMBS, 0.03))
    finger_speed_m_s: crux_nodes.Array = field(default_factory=lambda: np.zeros(LIMBS))
    finger_force_N: crux_nodes.Array = field(default_factory=lambda: np.zeros(LIMBS))
    ft_wrench: crux_nodes.Array = field(default_factory=lambda: np.zeros((LIMBS, 6)))


class Host:
    """Sends whole cycles on four buses and hears what the nodes answer."""

    def __init__(self, nodes: crux_nodes.Nodes, buses: list[can.BusABC], urls: list[str], dt_s: float) -> None:
        self.nodes = nodes
        self.buses = buses
        self.urls = urls
        self.dt_s = dt_s
        self.plant = Plant()
        self._counters: dict[tuple[int, int], int] = defaultdict(int)

    def send(self, limb: int, name: str, values: can_codec.Values, node: int | None = None) -> None:
        """One protected frame with the next counter of its identifier."""
        identifier = can_codec.message(name, node).frame_id
        self._counters[limb, identifier] += 1
        frame = can_codec.encode(name, values, self._counters[limb, identifier], node)
        self.send_raw(limb, frame.identifier, frame.data)

    def send_raw(self, limb: int, identifier: int, data: bytes) -> None:
        """Any bytes as a CAN FD frame."""
        self.buses[limb].send(
            can.Message(arbitration_id=identifier, data=data, is_extended_id=False, is_fd=True, bitrate_switch=True)
        )

    def send_cycle(self, cycle: int, joint: can_codec.Values, gripper: can_codec.Values) -> None:
        """The same commands to every joint and gripper, then the Syncs."""
        for limb in range(LIMBS):
            for node in can_codec.JOINT_NODES:
                self.send(limb, "JointCommand", joint, node)
            self.send(limb, "GripperCommand", gripper)
            self.send(limb, "Sync", {"Cycle": cycle})

    def control(self) -> tuple[crux_nodes.Array, crux_nodes.Array]:
        plant = self.plant
        return self.nodes.control(
            self.dt_s,
            plant.joint_position_rad,
            plant.joint_velocity_rad_s,
            plant.finger_opening_m,
            plant.finger_speed_m_s,
            plant.finger_force_N,
        )

    def publish(self) -> None:
        plant = self.plant
        self.nodes.publish(
            plant.joint_position_rad,
            plant.joint_velocity_rad_s,
            plant.joint_torque_Nm,
            plant.finger_opening_m,
            plant.finger_speed_m_s,
            plant.finger_force_N,
            plant.ft_wrench,
        )

    def run(
        self, cycle: int, joint: can_codec.Values, gripper: can_codec.Values
    ) -> tuple[crux_nodes.Array, crux_nodes.Array]:
        """A whole cycle; returns the nodes' torques and forces."""
        self.send_cycle(cycle, joint, gripper)
        assert self.nodes.wait_sync(2.0) == cycle
        outputs = self.control()
        self.publish()
        return outputs

    def heard(self, limb: int) -> dict[tuple[str, int | None], list[can_codec.Values]]:
        """What the nodes of a limb have sent since the last call; every frame's CRC is checked."""
        found: dict[tuple[str, int | None], list[can_codec.Values]] = defaultdict(list)
        while (message := self.buses[limb].recv(timeout=0.0)) is not None:
            frame = can_codec.Frame(message.arbitration_id, bytes(message.data))
            decoded = can_codec.decode(frame)
            if decoded.name not in ("JointCommand", "GripperCommand", "Sync", "HostHeartbeat"):
                assert can_codec.check(frame, can_codec.Receiver()) is can_codec.Verdict.OK
                assert message.is_fd
                assert message.bitrate_switch
                found[decoded.name, decoded.node].append(decoded.values)
        return found


@contextmanager
def host(robot: Robot) -> Iterator[Host]:
    """Nodes with the robot's parameters on buses of their own."""
    with ExitStack() as stack:
        ports = stack.enter_context(run_ports())
        urls = ports.bus_urls()
        nodes = stack.enter_context(
            crux_nodes.Nodes(
                built(LIBRARY),
                urls,
                crux_nodes.joint_parameters(robot),
                crux_nodes.gripper_parameters(robot),
                crux_nodes.parameter_hash(robot),
            )
        )
        buses = []
        for url in urls:
            bus = can.Bus(interface="udp_multicast", channel=BUS_GROUP, port=int(url.split(":")[2]), hop_limit=0)
            stack.callback(bus.shutdown)
            buses.append(bus)
        yield Host(nodes, buses, urls, robot.dt_s)
