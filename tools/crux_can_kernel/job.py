"""What `crux can run` is asked to do, and how its back-ends say that they cannot."""

from __future__ import annotations

from dataclasses import dataclass

from crux_tools.can import CANFD_MTU

DEFAULT_TIMEOUT_S = 600.0
DEFAULT_INTERFACE = "vcan0"
TIMED_OUT, NO_KERNEL = 124, 125  # exit statuses, as of timeout(1) and of container runners
QUEUE_FRAMES = 1000  # of a virtual interface: many cycles, so that a burst never blocks


class NoKernel(Exception):
    """A back-end that cannot be had on this machine, or whose kernel did not reach the command; says why."""


@dataclass(frozen=True)
class Job:
    """A command and what it needs."""

    command: tuple[str, ...]
    interfaces: tuple[str, ...] = (DEFAULT_INTERFACE,)
    timeout_s: float = DEFAULT_TIMEOUT_S
    virtual_time: bool = False
    memory_MiB: int = 1024
    verbose: bool = False


def interface_script(interfaces: tuple[str, ...]) -> str:
    """Shell lines that make virtual CAN FD interfaces and bring them up; the first failure ends the shell with 125."""
    lines = ["ip link set lo up"]
    for name in interfaces:
        lines.append(f"ip link add {name} type vcan")
        lines.append(f"ip link set {name} mtu {CANFD_MTU} txqueuelen {QUEUE_FRAMES} up")
    return "".join(f"{line} || exit {NO_KERNEL}\n" for line in lines)
