"""CAN interfaces as `ip -details -json link show` tells of them, compared with what the robot's buses need."""

from __future__ import annotations

import json
import shlex
import subprocess
from dataclasses import dataclass, field
from typing import Any

from crux_contracts import can_codec
from crux_contracts.robot import Robot

from crux_tools.can import CANFD_MTU
from crux_tools.errors import WorkFailed

SAMPLE_POINT = 0.8  # of a bit, both rates; the nodes' own (firmware/ports/stm32g474/fdcan.c)
SAMPLE_TOLERANCE = 0.026
RESTART_MS = 100  # after bus-off
FRAMES_A_CYCLE = can_codec.NODES + 2  # heartbeat, a command for each node, Sync
QUEUE_CYCLES = 2  # a queue longer than the nodes' watchdog would play old commands after a jam
QUEUE_FRAMES = QUEUE_CYCLES * FRAMES_A_CYCLE
VIRTUAL = ("vcan", "vxcan")
WELL = "ERROR-ACTIVE"


@dataclass(frozen=True)
class Interface:
    """What the kernel says of one interface."""

    name: str
    kind: str
    up: bool
    mtu: int
    queue_frames: int
    modes: tuple[str, ...] = ()
    state: str = ""
    restart_ms: int = 0
    bit_rate: int = 0
    sample_point: float = 0.0
    data_bit_rate: int = 0
    data_sample_point: float = 0.0
    errors: dict[str, int] = field(default_factory=dict)
    """error counters of receiver and transmitter; how often the controller restarted, erred, lost arbitration, …"""

    @property
    def is_virtual(self) -> bool:
        """Has neither bits nor errors."""
        return self.kind in VIRTUAL


def parse(text: str) -> list[Interface]:
    """CAN interfaces in the output of `ip -details -json link show`. Raises WorkFailed."""
    try:
        links = json.loads(text or "[]")
    except ValueError as error:
        raise WorkFailed(f"ip: no JSON: {error}") from None
    return [_interface(link) for link in links if link.get("link_type") == "can"]


def _interface(link: dict[str, Any]) -> Interface:
    info = link.get("linkinfo", {})
    data = info.get("info_data", {})
    nominal, fast = data.get("bittiming", {}), data.get("data_bittiming", {})
    counters = {f"{way}_errors": int(count) for way, count in data.get("berr_counter", {}).items()}
    return Interface(
        name=str(link["ifname"]),
        kind=str(info.get("info_kind", "")),
        up="UP" in link.get("flags", []),
        mtu=int(link.get("mtu", 0)),
        queue_frames=int(link.get("txqlen", 0)),
        modes=tuple(data.get("ctrlmode", [])),
        state=str(data.get("state", "")),
        restart_ms=int(data.get("restart_ms", 0)),
        bit_rate=int(nominal.get("bitrate", 0)),
        sample_point=float(nominal.get("sample_point", 0.0)),
        data_bit_rate=int(fast.get("bitrate", 0)),
        data_sample_point=float(fast.get("sample_point", 0.0)),
        errors=counters | {name: int(count) for name, count in info.get("info_xstats", {}).items()},
    )


def present() -> dict[str, Interface]:
    """This machine's CAN interfaces by name. Raises WorkFailed."""
    try:
        shown = subprocess.run(
            ["ip", "-details", "-json", "-statistics", "link", "show"], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        raise WorkFailed("there is no command 'ip' (as root: apt-get install iproute2)") from None
    if shown.returncode != 0:
        raise WorkFailed(f"ip link show: {shown.stderr.strip()}")
    return {interface.name: interface for interface in parse(shown.stdout)}


def set_up_commands(interface: Interface, robot: Robot) -> list[list[str]]:
    """What makes it a bus of the robot, as root."""
    link = ["ip", "link", "set", interface.name]
    if interface.is_virtual:
        return [[*link, "down"], [*link, "mtu", str(CANFD_MTU)], [*link, "up"]]
    timing = ["bitrate", str(robot.can.bit_rate), "sample-point", str(SAMPLE_POINT)]
    timing += ["dbitrate", str(robot.can.data_bit_rate), "dsample-point", str(SAMPLE_POINT), "fd", "on"]
    return [
        [*link, "down"],
        [*link, "type", "can", *timing, "berr-reporting", "on", "restart-ms", str(RESTART_MS)],
        [*link, "txqueuelen", str(QUEUE_FRAMES)],
        [*link, "up"],
    ]


def shell_line(command: list[str]) -> str:
    """A command as one would type it."""
    return shlex.join(command)


def defects(interface: Interface, robot: Robot) -> list[str]:
    """What is wrong with an interface, each with what would be right; empty when the robot can use it."""
    found = []
    if not interface.up:
        found.append("it is down")
    if interface.mtu < CANFD_MTU:
        found.append(f"it does not carry CAN FD: mtu {interface.mtu}, right is {CANFD_MTU}")
    return found if interface.is_virtual else found + _controller_defects(interface, robot)


def _controller_defects(interface: Interface, robot: Robot) -> list[str]:
    found = []
    for what, is_rate, should_rate, is_point in (
        ("bit rate", interface.bit_rate, robot.can.bit_rate, interface.sample_point),
        ("data bit rate", interface.data_bit_rate, robot.can.data_bit_rate, interface.data_sample_point),
    ):
        if is_rate != should_rate:
            found.append(f"{what} {is_rate}, right is {should_rate}")
        elif abs(is_point - SAMPLE_POINT) > SAMPLE_TOLERANCE:
            found.append(f"sample point {is_point:g} of the {what}, right is {SAMPLE_POINT:g} as in the nodes")
    if interface.queue_frames > QUEUE_FRAMES:
        found.append(
            f"transmit queue of {interface.queue_frames} frames, right are at most {QUEUE_FRAMES}: a longer one "
            "plays old commands after a jam"
        )
    elif interface.queue_frames < FRAMES_A_CYCLE:
        found.append(f"transmit queue of {interface.queue_frames} frames, a cycle has {FRAMES_A_CYCLE}")
    if interface.restart_ms == 0:
        found.append(f"no restart after bus-off: restart-ms 0, right is {RESTART_MS}")
    if "BERR-REPORTING" not in interface.modes:
        found.append("errors on the bus are not reported (berr-reporting off)")
    if interface.up and interface.state != WELL:
        found.append(f"its controller is {interface.state or 'in no known state'}, right is {WELL}")
    return found
