"""ctypes binding of libcrux_nodes.so: the firmware nodes of a robot (see crux_nodes.h for meaning and order)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from crux_contracts import LIMB_NAMES, node_parameters
from crux_contracts.robot import Robot
from crux_contracts.robot_bounds import MOST_JOINTS as JOINTS_PER_LIMB
from crux_contracts.robot_types import of_slots

LIMBS = len(LIMB_NAMES)
JOINTS = LIMBS * JOINTS_PER_LIMB
NODES_PER_LIMB = JOINTS_PER_LIMB + 1
NO_HOST_STATE = 0xFF

Array = npt.NDArray[np.float64]


def _members(kind: str) -> list[tuple[str, type[ctypes.c_float] | type[ctypes.c_uint32]]]:
    return [(p.name, ctypes.c_float if p.kind == "float" else ctypes.c_uint32) for p in node_parameters.table()[kind]]


class JointParameters(ctypes.Structure):
    """crux_joint_parameters: the table of msgs/can/parameters.yaml."""

    _fields_ = _members("joint")


class GripperParameters(ctypes.Structure):
    """crux_gripper_parameters: as above."""

    _fields_ = _members("gripper")


class NodeCounters(ctypes.Structure):
    """crux_node_counters of core/link.h."""

    _fields_ = [
        ("syncs", ctypes.c_uint32),
        ("commands", ctypes.c_uint32),
        ("rejected_crc", ctypes.c_uint32),
        ("rejected_counter", ctypes.c_uint32),
        ("rejected_invalid", ctypes.c_uint32),
        ("timeouts", ctypes.c_uint32),
        ("queue_overflows", ctypes.c_uint32),
    ]


class NodesError(Exception):
    """A bus that cannot be opened or refuses, parameters that make no sense, or a node that does not exist."""


def joint_parameters(robot: Robot) -> list[JointParameters]:
    """Parameters of the 28 joint nodes, limb-major; a node without a joint has those of the limb's last one."""
    servo = robot.servo
    return [
        JointParameters(
            position_min_rad=low_rad,
            position_max_rad=high_rad,
            velocity_limit_rad_s=speed_rad_s,
            torque_limit_Nm=torque_Nm,
            position_gain_Nm_rad=position_gain,
            velocity_gain_Nms_rad=velocity_gain,
            setpoint_time_constant_s=servo.setpoint_time_constant_s,
            max_deceleration_rad_s2=servo.max_deceleration_rad_s2,
            temperature_limit_degC=servo.temperature_limit_degC,
            period_us=round(robot.dt_s * 1e6),
            watchdog_cycles=robot.can.watchdog_cycles,
        )
        for limb in robot.limbs
        for low_rad, high_rad, speed_rad_s, torque_Nm, position_gain, velocity_gain in zip(
            of_slots(limb.actuators.low_rad.tolist()),
            of_slots(limb.actuators.high_rad.tolist()),
            of_slots(limb.actuators.speed_rad_s.tolist()),
            of_slots(limb.actuators.torque_Nm.tolist()),
            of_slots(servo.position_gain_Nm_rad),
            of_slots(servo.velocity_gain_Nms_rad),
            strict=True,
        )
    ]


def gripper_parameters(robot: Robot) -> list[GripperParameters]:
    """Parameters of the four gripper nodes from the robot description."""
    gripper = robot.gripper
    return [
        GripperParameters(
            opening_min_m=gripper.opening_m[0],
            opening_max_m=gripper.opening_m[1],
            speed_limit_m_s=gripper.max_finger_speed_m_s,
            force_limit_N=gripper.max_finger_force_N,
            stiffness_N_m=gripper.stiffness_N_m,
            damping_Ns_m=gripper.damping_Ns_m,
            force_range_N=robot.force_torque.range_N,
            moment_range_Nm=robot.force_torque.range_Nm,
            temperature_limit_degC=gripper.temperature_limit_degC,
            period_us=round(robot.dt_s * 1e6),
            watchdog_cycles=robot.can.watchdog_cycles,
        )
        for _ in robot.limbs
    ]


def parameter_hash(robot: Robot) -> int:
    """What the nodes give as Identity.ParameterHash: the first four bytes of the robot description's hash."""
    return int(robot.hash[:8], 16)


def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    doubles = ctypes.POINTER(ctypes.c_double)
    bytes_ = ctypes.POINTER(ctypes.c_uint8)
    handle = ctypes.c_void_p
    integer = ctypes.c_int
    signatures: dict[str, tuple[object, list[object]]] = {
        "open": (handle, [ctypes.POINTER(ctypes.c_char_p), ctypes.POINTER(JointParameters),
                          ctypes.POINTER(GripperParameters), ctypes.c_uint32]),
        "close": (None, [handle]),
        "error": (ctypes.c_char_p, []),
        "wait_sync": (integer, [handle, integer, ctypes.POINTER(ctypes.c_uint32)]),
        "control": (None, [handle, ctypes.c_double, *[doubles] * 7]),
        "publish": (integer, [handle, *[doubles] * 7]),
        "host_state": (ctypes.c_uint8, [handle]),
        "states": (None, [handle, *[bytes_] * 4]),
        "counters": (integer, [handle, integer, integer, ctypes.POINTER(NodeCounters)]),
        "drop_received": (integer, [handle, integer, integer, ctypes.c_uint32]),
        "corrupt_received": (integer, [handle, integer, integer, ctypes.c_uint32]),
        "drop_sent": (integer, [handle, integer, integer, ctypes.c_uint32]),
        "disturb": (integer, [handle, integer, integer, integer]),
        "lose": (integer, [handle, integer, ctypes.c_double, ctypes.c_uint32]),
        "connect": (integer, [handle, integer, integer]),
        "intrude": (integer, [handle, integer, ctypes.c_uint16, ctypes.c_char_p, integer]),
        "trust": (None, [handle, ctypes.c_char_p]),
        "cut_power": (integer, [handle, integer, integer, ctypes.c_uint32]),
        "reset": (integer, [handle, integer, integer]),
        "power": (integer, [handle, integer, integer, integer]),
        "set_temperature": (integer, [handle, integer, integer, ctypes.c_double]),
    }  # fmt: skip
    for name, (result, arguments) in signatures.items():
        function = getattr(library, f"crux_nodes_{name}")
        function.restype = result
        function.argtypes = arguments
    return library


def _pointer(values: npt.ArrayLike, count: int) -> tuple[Array, object]:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.size != count:
        raise ValueError(f"{array.size} numbers where {count} belong")
    return array, array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


class Nodes:
    """The nodes on four buses. Joint arrays hold 28 numbers, seven slots a limb, finger arrays 4; a context manager."""

    def __init__(
        self,
        library: Path,
        bus_urls: Sequence[str],
        joints: Sequence[JointParameters],
        grippers: Sequence[GripperParameters],
        parameter_hash: int = 0,
    ) -> None:
        """Opens the buses (udp:, socketcan:, memory:), in limb order; raises NodesError when that fails."""
        if len(bus_urls) != LIMBS or len(joints) != JOINTS or len(grippers) != LIMBS:
            raise ValueError(f"four buses, {JOINTS} joints and four grippers belong here")
        self._library = _load(library)
        urls = (ctypes.c_char_p * LIMBS)(*(url.encode() for url in bus_urls))
        self._handle = self._library.crux_nodes_open(
            urls, (JointParameters * JOINTS)(*joints), (GripperParameters * LIMBS)(*grippers), parameter_hash
        )
        if not self._handle:
            raise self._error()
        self._torque = np.zeros(JOINTS)
        self._force = np.zeros(LIMBS)
        self._cycle = ctypes.c_uint32()

    def __enter__(self) -> Nodes:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the buses; the second time nothing happens."""
        if self._handle:
            self._library.crux_nodes_close(self._handle)
            self._handle = None

    @property
    def handle(self) -> ctypes.c_void_p:
        """The crux_nodes, for other libraries."""
        return ctypes.c_void_p(self._handle)

    def _error(self) -> NodesError:
        return NodesError(self._library.crux_nodes_error().decode(errors="replace"))

    def _check(self, result: int) -> int:
        if result < 0:
            raise self._error()
        return result

    def replace(self, limb: int, node: int, port: int) -> None:
        """From now on the node runs elsewhere: `port` is the address of its crux_outside_node."""
        replace = self._library.crux_nodes_replace
        replace.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.c_void_p]
        self._check(replace(self._handle, limb, node, port))

    def wait_sync(self, timeout_s: float) -> int | None:
        """The cycle whose Sync has arrived on all buses, or None when the time ran out."""
        found = self._library.crux_nodes_wait_sync(
            self._handle, max(0, round(timeout_s * 1000)), ctypes.byref(self._cycle)
        )
        return int(self._cycle.value) if self._check(found) else None

    def control(
        self,
        dt_s: float,
        joint_position_rad: npt.ArrayLike,
        joint_velocity_rad_s: npt.ArrayLike,
        finger_opening_m: npt.ArrayLike,
        finger_speed_m_s: npt.ArrayLike,
        finger_force_N: npt.ArrayLike,
    ) -> tuple[Array, Array]:
        """One control period; returns joint torque [Nm] (28,) and finger force [N] (4,)."""
        keep = [
            _pointer(values, count)
            for values, count in (
                (joint_position_rad, JOINTS),
                (joint_velocity_rad_s, JOINTS),
                (finger_opening_m, LIMBS),
                (finger_speed_m_s, LIMBS),
                (finger_force_N, LIMBS),
                (self._torque, JOINTS),
                (self._force, LIMBS),
            )
        ]
        self._library.crux_nodes_control(self._handle, dt_s, *(pointer for _, pointer in keep))
        return self._torque.copy(), self._force.copy()

    def publish(
        self,
        joint_position_rad: npt.ArrayLike,
        joint_velocity_rad_s: npt.ArrayLike,
        joint_torque_Nm: npt.ArrayLike,
        finger_opening_m: npt.ArrayLike,
        finger_speed_m_s: npt.ArrayLike,
        finger_force_N: npt.ArrayLike,
        ft_wrench: npt.ArrayLike,
    ) -> None:
        """Answers the last Sync; `ft_wrench` (4, 6): fx fy fz [N] mx my mz [Nm] in the gripper frames."""
        keep = [
            _pointer(values, count)
            for values, count in (
                (joint_position_rad, JOINTS),
                (joint_velocity_rad_s, JOINTS),
                (joint_torque_Nm, JOINTS),
                (finger_opening_m, LIMBS),
                (finger_speed_m_s, LIMBS),
                (finger_force_N, LIMBS),
                (ft_wrench, LIMBS * 6),
            )
        ]
        self._check(self._library.crux_nodes_publish(self._handle, *(pointer for _, pointer in keep)))

    def host_state(self) -> int:
        """HostState of the last HostHeartbeat on any bus; NO_HOST_STATE before the first."""
        return int(self._library.crux_nodes_host_state(self._handle))

    def states(self) -> tuple[bytes, bytes, bytes, bytes]:
        """States of the joints, their fault bits, states of the grippers, their fault bits."""
        buffers = [(ctypes.c_uint8 * count)() for count in (JOINTS, JOINTS, LIMBS, LIMBS)]
        self._library.crux_nodes_states(self._handle, *buffers)
        joint_state, joint_faults, gripper_state, gripper_faults = (bytes(buffer) for buffer in buffers)
        return joint_state, joint_faults, gripper_state, gripper_faults

    def counters(self, limb: int, node: int) -> NodeCounters:
        """Counters of node 1..8 of limb 0..3."""
        counters = NodeCounters()
        self._check(self._library.crux_nodes_counters(self._handle, limb, node, ctypes.byref(counters)))
        return counters

    def drop_received(self, limb: int, node: int, count: int) -> None:
        """The node does not hear its next `count` commands and Syncs."""
        self._check(self._library.crux_nodes_drop_received(self._handle, limb, node, count))

    def corrupt_received(self, limb: int, node: int, count: int) -> None:
        """The node hears its next `count` commands and Syncs with a flipped bit."""
        self._check(self._library.crux_nodes_corrupt_received(self._handle, limb, node, count))

    def drop_sent(self, limb: int, node: int, count: int) -> None:
        """The next `count` frames of the node get lost."""
        self._check(self._library.crux_nodes_drop_sent(self._handle, limb, node, count))

    def disturb(self, limb: int, node: int, on: bool) -> None:
        """While on, no frame passes between the node and its bus, and its controller goes off."""
        self._check(self._library.crux_nodes_disturb(self._handle, limb, node, int(on)))

    def lose(self, limb: int, share: float, seed: int = 1) -> None:
        """From now on this share of the frames to and from each node of the limb gets lost; 1 cuts the bus."""
        self._check(self._library.crux_nodes_lose(self._handle, limb, share, seed))

    def connect(self, limb: int, connected: bool) -> None:
        """Whether the limb's bus exists for the nodes."""
        self._check(self._library.crux_nodes_connect(self._handle, limb, int(connected)))

    def intrude(self, limb: int, identifier: int, data: bytes) -> None:
        """A rogue host's frame goes out on the limb's bus, and its nodes receive it."""
        self._check(self._library.crux_nodes_intrude(self._handle, limb, identifier, data, len(data)))

    def trust(self, public_key: bytes) -> None:
        """Nodes take images signed with this Ed25519 key (32 bytes) from now on."""
        if len(public_key) != 32:
            raise ValueError(f"a public key has 32 bytes, not {len(public_key)}")
        self._library.crux_nodes_trust(self._handle, public_key)

    def cut_power(self, limb: int, node: int, operation: int) -> None:
        """The power of the node's flash fails within that write or erase from now on; 0 brings it back."""
        self._check(self._library.crux_nodes_cut_power(self._handle, limb, node, operation))

    def reset(self, limb: int, node: int) -> None:
        """The node restarts as after a loss of power."""
        self._check(self._library.crux_nodes_reset(self._handle, limb, node))

    def power(self, limb: int, node: int, supply: int) -> None:
        """From now on the node has power (0), or none, its motor's windings in short circuit (1) or open (2)."""
        self._check(self._library.crux_nodes_power(self._handle, limb, node, supply))

    def set_temperature(self, limb: int, node: int, temperature_degC: float) -> None:
        """What the node's thermometer reads from now on."""
        self._check(self._library.crux_nodes_set_temperature(self._handle, limb, node, temperature_degC))
