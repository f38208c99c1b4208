"""Starts runtimes for tests, each on ports of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from crux_contracts import LIMB_NAMES
from crux_msgs import command_t
from crux_simulation.sim.ports import RunPorts, run_ports
from crux_simulation.sim.runtime_process import START_TRIES, START_TRY_S
from crux_tools.operator_link import OperatorLink
from crux_tools.paths import ROOT, built

ROBOT = ROOT / "msgs" / "robots" / "scaler"
END_TIMEOUT_S = 600  # the machine may be slow and busy
INSECURE = re.compile(r"crux-runtime: INSECURE: whoever reaches LCM at \S+ commands the robot\n")


@dataclass
class Runtime:
    """A running crux-runtime and the operator's line to it."""

    process: subprocess.Popen[str]
    ports: RunPorts
    link: OperatorLink
    log: Path

    def end(self) -> tuple[int, str]:
        """Waits for it to end; exit status and what it wrote on standard error, but that it is insecure."""
        _, stderr = self.process.communicate(timeout=END_TIMEOUT_S)
        return self.process.returncode, INSECURE.sub("", stderr, count=1)


class Starter:
    """Starts runtimes and ends what is left of them."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack = stack
        self._folder = folder
        self._count = 0

    def __call__(self, *extra: str, pace: str = "bus", ports: RunPorts | None = None) -> Runtime:
        """A runtime that answers its operators, on ports of its own where none are given."""
        self._count += 1
        log = self._folder / f"log{self._count}.mcap"
        ports = ports or self._stack.enter_context(run_ports())
        command = [str(built("runtime/app/crux-runtime")), "--robot", str(ROBOT), "--pace", pace]
        command += [] if "--keys" in extra else ["--insecure"]
        command += ["--lcm", ports.lcm_url, "--log", str(log), *extra]
        for limb, url in zip(LIMB_NAMES, ports.bus_urls(), strict=True):
            command += ["--bus", f"{limb}={url}"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self._stack.callback(self._end, process)
        link = self._stack.enter_context(OperatorLink(ports.lcm_url))
        assert link.command(command_t.STATUS, tries=START_TRIES, timeout_s=START_TRY_S) is not None, (
            "the runtime does not answer"
        )
        return Runtime(process, ports, link, log)

    @staticmethod
    def _end(process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            process.kill()
        process.communicate()


def _rerun(*words: str | Path) -> str:
    rerun = Path(sys.executable).with_name("rerun")
    done = subprocess.run([rerun, "mcap", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def rerun_info(log: Path) -> str:
    """What rerun finds in a log that was closed; fails when it cannot open it."""
    return _rerun("info", log)


def rerun_recovered(log: Path) -> str:
    """What rerun finds in a log without a summary, which it makes itself; fails when it cannot."""
    return _rerun("convert", "--recover", log, "-o", log.with_suffix(".rrd"))
