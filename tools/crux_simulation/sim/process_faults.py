"""What goes wrong with the runtime's process and its machine: killed, stopped, starved of CPU, flooded, its disk full.

Killed and stopped by signals; starved as by a quota of the kernel's scheduler, which stops a process for the rest of
each period once it has had its share; a full disk by a limit on the size of its files, which ends writes as a full disk
does. The flood comes from a process of its own (lcm_flood.py).
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from crux_tools.errors import UsageError

from crux_simulation.sim.fault_file import BY_THE_CLOCK, OF_THE_RUNTIME, Fault
from crux_simulation.sim.runtime_process import RuntimeProcess

QUOTA_PERIOD_S = 0.1  # cpu.max of the kernel's CPU controller, unless told otherwise
FLOOD = "crux_simulation.sim.lcm_flood"


def check_process_faults(faults: Sequence[Fault], bus: str, pace: str) -> None:
    """Raises UsageError for faults that the run cannot have."""
    for fault in faults:
        if fault.kind in OF_THE_RUNTIME and bus == "memory":
            raise UsageError(f"fault '{fault.kind}' needs a runtime of its own: --bus udp or --bus socketcan")
        if fault.kind in BY_THE_CLOCK and pace != "realtime":
            raise UsageError(f"fault '{fault.kind}': in lockstep physics waits for the runtime; --pace realtime")


class ProcessFaults:
    """Carries them out; leaving the context ends what still goes on."""

    def __init__(self, runtime: RuntimeProcess, log: Path) -> None:
        self._runtime = runtime
        self._log = log
        self._flood: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def __enter__(self) -> ProcessFaults:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Ends what still goes on."""
        self._stop(False)
        self._end_flood()

    def switch(self, fault: Fault, on: bool) -> None:
        """Begins or ends a fault."""
        if fault.kind == "runtime_killed":
            self._signal(signal.SIGKILL)
        elif fault.kind in BY_THE_CLOCK:
            self._stop(on and fault.kind == "runtime_stopped")
        elif fault.kind == "disk_full" and on:
            full = self._log.stat().st_size
            with suppress(ProcessLookupError):
                resource.prlimit(self._runtime.pid, resource.RLIMIT_FSIZE, (full, full))
        elif fault.kind == "lcm_flooded" and on:
            words = [sys.executable, "-m", FLOOD, self._runtime.lcm_url]
            not_in_real_time = ("chrt", "--other", "0")  # as the simulation may be
            self._flood = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", *not_in_real_time, *words])
        elif fault.kind == "lcm_flooded":
            self._end_flood()

    def go_on(self, fault: Fault, since_s: float) -> None:
        """What a fault does in each period of its time, `since_s` after its beginning."""
        if fault.kind == "cpu_starved":
            self._stop(since_s % QUOTA_PERIOD_S >= fault.share * QUOTA_PERIOD_S)

    def _stop(self, stopped: bool) -> None:
        if stopped != self._stopped:
            self._signal(signal.SIGSTOP if stopped else signal.SIGCONT)
            self._stopped = stopped

    def _signal(self, number: signal.Signals) -> None:
        if self._runtime.is_alive():
            os.kill(self._runtime.pid, number)

    def _end_flood(self) -> None:
        if self._flood is not None:
            self._flood.kill()
            self._flood.wait()
            self._flood = None
