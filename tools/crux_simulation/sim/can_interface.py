"""What can be done to a CAN interface of the kernel from outside: take it down, fill its queue, report errors on it."""

from __future__ import annotations

import socket
import struct
import subprocess

from crux_tools.errors import WorkFailed

# linux/can/error.h
ERROR_FLAG = 0x20000000
CONTROLLER, ACKNOWLEDGE, BUS_OFF, RESTARTED = 0x04, 0x20, 0x40, 0x100
TX_PASSIVE, ERROR_ACTIVE = 0x20, 0x40
QUEUE_FRAMES = 5  # of the jammed queue: less than a cycle


def _call(*words: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise WorkFailed(f"{' '.join(words)}: {done.stderr.strip() or f'status {done.returncode}'}")


def set_up(interface: str, up: bool) -> None:
    """Interface up or down; needs root."""
    _call("ip", "link", "set", interface, "up" if up else "down")


def jam(interface: str, jammed: bool) -> None:
    """Frames stay in a queue that is soon full, as on a bus where nobody acknowledges; needs root."""
    if jammed:
        _call("tc", "qdisc", "add", "dev", interface, "root", "netem", "delay", "100s", "limit", str(QUEUE_FRAMES))
    else:
        _call("tc", "qdisc", "del", "dev", interface, "root")


def report(interface: str, error: int, controller: int = 0) -> None:
    """An error frame as the interface's driver would report it."""
    data = bytes([0, controller, 0, 0, 0, 0, 0, 0])
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.bind((interface,))
        bus.send(struct.pack("=IB3x8s", ERROR_FLAG | error, len(data), data))
