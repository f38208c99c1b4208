"""The runtime as a process of its own, exactly as it runs on the robot."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO

from crux_contracts import LIMB_NAMES
from crux_msgs import command_t
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.operator_link import OperatorLink
from crux_tools.output import note
from crux_tools.paths import built

BINARY = "runtime/app/crux-runtime"
USAGE_STATUS = 2  # of the runtime: options, robot description, bus or LCM
LOG_STATUS = 1  # of the runtime: the log could not be written
LOG_TROUBLE = re.compile(r"log .*: cannot be \w+: (.*?)( \(os error \d+\))?(;|$)", re.MULTILINE)
START_TRIES, START_TRY_S = 400, 0.05
GUARD_TIME_S = 10.0  # lockstep: a busy machine must not make the runtime go on without its nodes
LEAST_GUARD_TIME_S = 0.02  # in each of the cycles in which nodes cannot answer; all of them together: GUARD_TIME_S
STOP_TIMEOUT_S = 20.0
STDERR_SHOWN = 400  # characters of a dead runtime's last words


def guard_time_s(mute_cycles: float) -> float:
    """How long the runtime is to wait for its nodes in lockstep, in s of wall time, where faults keep some of them from
    answering for so many cycles: as long as a run can afford, for nodes may just be late."""
    return max(LEAST_GUARD_TIME_S, GUARD_TIME_S / max(1.0, mute_cycles))


def runtime_arguments(
    robot_dir: Path,
    log: Path,
    commands: str,
    tags: dict[str, str],
    switches: Mapping[str, bool] | None = None,
    keys: Path | None = None,
    state: Path | None = None,
) -> list[str]:
    """What crux-runtime is told wherever it runs. A log that is there already is replaced.

    `commands`: each or broadcast; `tags`: what the log is to say of itself; `switches`: its options without a value;
    `keys`: of those who may command it, None: it is nobody's but this simulation's; `state`: the folder where it keeps
    what it needs after a restart, None: nothing is kept.
    """
    said = (word for key, value in tags.items() for word in ("--tag", f"{key}={value}"))
    who = ["--insecure"] if keys is None else ["--keys", str(keys)]
    given = [*who, "--overwrite", *(name for name, on in (switches or {}).items() if on)]
    place = ["--state", "none" if state is None else str(state)]
    return ["--robot", str(robot_dir), "--log", str(log), *place, *given, "--commands", commands, *said]


def log_reason(said: str) -> str:
    """Why a log could not be written, from the runtime's words; empty when they are about something else."""
    found = LOG_TROUBLE.search(said)
    return found[1][:1].lower() + found[1][1:] if found else ""


class RuntimeProcess:
    """Starts crux-runtime; leaving the context ends it."""

    def __init__(self, bus_urls: list[str], pace: str, lcm_url: str, guard_s: float, arguments: list[str]) -> None:
        """`guard_s`: how long the runtime waits for the nodes in lockstep; `arguments`: runtime_arguments()."""
        self.lcm_url = lcm_url
        self._arguments = [
            *("setpriv", "--pdeathsig", "TERM"),  # it ends with the simulation, however that ends
            *(str(built(BINARY)), "--pace", pace, "--lcm", lcm_url, "--guard-time", str(guard_s), *arguments),
            *(word for name, url in zip(LIMB_NAMES, bus_urls, strict=True) for word in ("--bus", f"{name}={url}")),
        ]
        self._stderr: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 closed in __exit__

    def __enter__(self) -> RuntimeProcess:
        self._process = subprocess.Popen(self._arguments, stdout=subprocess.DEVNULL, stderr=self._stderr)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self._stderr.close()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def is_alive(self) -> bool:
        """False once the process has ended."""
        return self._process.poll() is None

    def goes_on(self) -> bool:
        """As is_alive; a process that was killed is started again, as a robot's computer does it, and writes another
        log."""
        ended = self._process.poll()
        if ended is None or ended >= 0:
            return ended is None
        note(f"crux-runtime was ended by signal {-ended}; it is started again")
        self._arguments = [word for word in self._arguments if word != "--overwrite"]
        self.__enter__()
        return True

    @property
    def crashed(self) -> bool:
        """It has ended, but neither as asked for nor for the sake of its log."""
        return self._process.poll() not in (None, 0, LOG_STATUS)

    def _said(self) -> str:
        self._stderr.seek(0)
        return self._stderr.read().decode(errors="replace")

    def log_trouble(self) -> str:
        """Why the log of a process that has ended is incomplete; empty when nothing is known against it."""
        if self._process.poll() != LOG_STATUS:
            return ""
        return log_reason(self._said()) or self.last_words()

    def last_words(self) -> str:
        """How the process ended and what it wrote last on standard error, on one line."""
        text = " ".join(self._said().split())[-STDERR_SHOWN:]
        code = self._process.poll()
        how = f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with status {code}"
        return f"{how}{': ' + text if text else ''}"

    def await_answer(self, link: OperatorLink) -> None:
        """Waits until the runtime acknowledges STATUS; raises UsageError or WorkFailed with its last words."""
        if link.command(command_t.STATUS, tries=START_TRIES, timeout_s=START_TRY_S, is_worth_it=self.is_alive) is None:
            if self._process.poll() == USAGE_STATUS:
                raise UsageError(f"crux-runtime {self.last_words()}")
            raise WorkFailed(f"crux-runtime {'does not answer' if self.is_alive() else self.last_words()}")

    def wait(self) -> None:
        """Waits for the process to end by itself, then ends it."""
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.end()

    def end(self) -> None:
        """SIGTERM, then SIGKILL."""
        if not self.is_alive():
            return
        self._process.terminate()
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
