"""A node's services over ISO-TP: requests out, answers back (msgs/can/README.md)."""

from __future__ import annotations

import re
import struct
import time
from dataclasses import dataclass
from typing import Any

from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.node_services import number, refusal
from crux_contracts.robot import Robot

from crux_tools.errors import UsageError, WorkFailed

DEFAULT_BUSES = "udp:239.74.163.2:43113"
ANSWER_S = 2.0
RESTART_S = 10.0
FRAME_BYTES = 64
REFUSED = number("service", "REFUSED")
ACCEPTED = number("service", "ACCEPTED")


class Refused(WorkFailed):
    """The node refuses; `code` is its reason."""

    def __init__(self, node: str, code: int) -> None:
        super().__init__(f"{node} refuses: {refusal(code)}")
        self.code = code


@dataclass(frozen=True)
class NodeName:
    """A node of a robot: limb 0..3, number 1..8."""

    limb: int
    number: int

    @property
    def kind(self) -> str:
        """joint or gripper: the tables are by these names."""
        return "gripper" if self.number == can_codec.GRIPPER_NODE else "joint"

    def __str__(self) -> str:
        node = (
            "gripper"
            if self.number == can_codec.GRIPPER_NODE
            else f"joint{can_codec.JOINT_NODES.index(self.number) + 1}"
        )
        return f"{LIMB_NAMES[self.limb]}.{node}"


def node_name(text: str) -> NodeName:
    """LF.joint3, RR.gripper, or by number: LF.3. Raises UsageError."""
    match = re.fullmatch(rf"({'|'.join(LIMB_NAMES)})\.(?:joint([1-7])|([1-8])|gripper)", text, re.IGNORECASE)
    if match is None:
        raise UsageError(
            f"node {text}: right is LIMB.joint1 .. LIMB.joint7 or LIMB.gripper, LIMB {'|'.join(LIMB_NAMES)}"
        )
    joint, number = match[2], match[3]
    node = can_codec.JOINT_NODES[int(joint) - 1] if joint else int(number or can_codec.GRIPPER_NODE)
    return NodeName(LIMB_NAMES.index(match[1].upper()), node)


def limb_bus(buses: str, robot: Robot, limb: int) -> str:
    """URL of a limb's bus: consecutive UDP ports, or interfaces whose names end in consecutive numbers."""
    match = re.fullmatch(r"(udp:[\d.]+:|socketcan:\D+)(\d+)", buses)
    if match is None:
        raise UsageError(f"--bus-base {buses}: right is udp:GROUP:PORT or socketcan:NAME0, of the first bus")
    return f"{match[1]}{int(match[2]) + robot.limbs[limb].bus}"


def open_bus(url: str) -> Any:
    """python-can's bus. Raises WorkFailed when it cannot be opened."""
    import can

    kind, _, rest = url.partition(":")
    try:
        if kind == "udp":
            group, _, port = rest.rpartition(":")
            return can.Bus(interface="udp_multicast", channel=group, port=int(port), hop_limit=0, fd=True)
        return can.Bus(interface="socketcan", channel=rest, fd=True)
    except (OSError, can.CanError) as error:
        raise WorkFailed(f"{url}: {error}") from error


class NodeLink:
    """Requests to one node; use as a context manager."""

    def __init__(self, name: NodeName, url: str, answer_s: float = ANSWER_S) -> None:
        """Opens the bus; raises WorkFailed when that fails."""
        import isotp

        self.name = name
        self._url = url
        self._answer_s = answer_s
        self._bus = open_bus(url)
        kind = "Gripper" if name.kind == "gripper" else "Joint"
        identifiers = [can_codec.message(f"{kind}{what}", name.number).frame_id for what in ("Request", "Response")]
        address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=identifiers[0], rxid=identifiers[1])
        parameters = {
            "can_fd": True,
            "bitrate_switch": True,
            "tx_data_length": FRAME_BYTES,
            "tx_padding": 0xCC,
            "rx_flowcontrol_timeout": round(1000 * answer_s),
            "blocking_send": True,
        }
        self._stack = isotp.CanStack(self._bus, address=address, params=parameters)
        self._stack.start()

    def __enter__(self) -> NodeLink:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.stop()
        self._bus.shutdown()

    def request(self, service: str, payload: bytes = b"") -> bytes:
        """What the node answers after the service's number. Raises Refused, or WorkFailed when it stays silent."""
        import isotp

        wanted = number("service", service)
        try:
            self._stack.send(bytes([wanted]) + payload, send_timeout=30.0)
            answer = self._stack.recv(block=True, timeout=self._answer_s)
        except isotp.IsoTpError as error:
            raise self._silent() from error
        if answer is None:
            raise self._silent()
        if len(answer) == 3 and answer[0] == REFUSED and answer[1] == wanted:
            raise Refused(str(self.name), answer[2])
        if answer[0] != wanted + ACCEPTED:
            raise WorkFailed(
                f"{self.name}: answers 0x{answer[0]:02X} to request 0x{wanted:02X}; is another tool asking?"
            )
        return bytes(answer[1:])

    def _silent(self) -> WorkFailed:
        return WorkFailed(f"{self.name} does not answer on {self._url}; is its bus up and the node powered?")

    def read(self, data: int) -> bytes:
        """Data of an identifier (msgs/can/services.yaml, plus a parameter's number)."""
        identifier = struct.pack(">H", data)
        answer = self.request("READ", identifier)
        if answer[:2] != identifier:
            raise WorkFailed(f"{self.name}: answers for other data than asked; is another tool asking?")
        return answer[2:]

    def restart(self) -> None:
        """Restarts the node, which drops what it holds: only with the robot off the wall. Waits until it is back.

        Raises Refused, or WorkFailed when the node does not come back.
        """
        self.request("RESET", struct.pack("<BI", 1, number("acknowledgement", "OFF_THE_WALL")))
        deadline_s = time.monotonic() + RESTART_S
        time.sleep(0.1)
        while True:
            try:
                self.read(number("data", "VERSION"))
                return
            except WorkFailed:
                if time.monotonic() > deadline_s:
                    raise
