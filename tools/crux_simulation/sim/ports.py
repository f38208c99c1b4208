"""UDP ports of one bench run, so that runs side by side do not hear each other."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import random
import socket
from collections.abc import Iterator
from dataclasses import dataclass

from crux_tools.private_folder import private_folder

BUS_GROUP = "239.74.163.2"
LCM_GROUP = "239.255.76.67"
PORTS = range(20000, 32000, 8)  # below the ephemeral ports; eight a run: four buses, LCM, spare
BUSES = 4
ATTEMPTS = 200


@dataclass(frozen=True)
class RunPorts:
    """The private addresses of one run."""

    base: int

    def bus_urls(self) -> list[str]:
        """Of LF, RF, LR, RR."""
        return [f"udp:{BUS_GROUP}:{self.base + limb}" for limb in range(BUSES)]

    @property
    def lcm_url(self) -> str:
        """LCM stays on this machine (ttl 0)."""
        return f"udpm://{LCM_GROUP}:{self.base + BUSES}?ttl=0"


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return False
    return True


@contextlib.contextmanager
def run_ports() -> Iterator[RunPorts]:
    """Ports nobody else uses, held by a lock file until the run ends. Raises OSError when none is left."""
    chooser = random.SystemRandom()
    for _ in range(ATTEMPTS):
        base = chooser.choice(PORTS)
        with contextlib.ExitStack() as held:
            try:  # the file stays: unlinking a locked file would let a third run lock its successor
                lock = held.enter_context((private_folder() / f"ports-{base}.lock").open("w"))
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            if all(_is_free(base + offset) for offset in range(BUSES + 1)):
                yield RunPorts(base)
                return
    raise OSError(f"no free UDP ports between {PORTS.start} and {PORTS.stop} for the buses")
