"""A guest kernel on the host's own files: the script that is its first process, and the host's side of it.

The guest's two serial lines become the command's standard output and standard error; its exit status comes through a
file. Guest and host share the root file system, so everything else is where the command expects it.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from crux_tools.output import note

from crux_can_kernel.job import NO_KERNEL, TIMED_OUT, Job, NoKernel, interface_script

POLL_S = 0.02
CONSOLE_SHOWN = 2000  # characters of a guest that did not start
NOT_PASSED_ON = {"PWD", "OLDPWD", "SHLVL", "_", "LD_PRELOAD"}

_FIRST_PROCESS = r"""#!/bin/sh
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
S=@STATE@
mountpoint -q /proc || mount -t proc proc /proc
mountpoint -q /sys || mount -t sysfs sysfs /sys
mountpoint -q /dev || mount -t devtmpfs devtmpfs /dev
mkdir -p /dev/pts /dev/shm
mount -t devpts devpts /dev/pts 2>/dev/null
mount -t tmpfs tmpfs /dev/shm
mount -t tmpfs tmpfs /run
ln -sf /proc/self/fd /dev/fd; ln -sf fd/0 /dev/stdin; ln -sf fd/1 /dev/stdout; ln -sf fd/2 /dev/stderr
mkdir -p /run/tmp
end() { echo "$1" >$S/status.new; mv $S/status.new $S/status; sync; @POWER_OFF@; sleep 60; }
n=0
while OUT=$(echo @OUT@) ERR=$(echo @ERR@); [ ! -c "$ERR" ] && [ $n -lt 50 ]; do n=$((n+1)); sleep 0.05; done
for o in $OUT $ERR; do case $o in /dev/tty*) stty -F $o raw -echo 2>/dev/null;; esac; done
exec 8>$OUT 9>$ERR 2>&9
for m in @MODULES@; do insmod $m || { echo "crux can run: guest: cannot load $m" >&2; end 125; }; done
(
@INTERFACES@) || { echo "crux can run: guest: cannot make the CAN interfaces" >&2; end 125; }
ip route add 224.0.0.0/4 dev lo
: >$S/booted
mkfifo /run/o /run/e
cat /run/o >&8 2>/dev/null & o=$!
cat /run/e >&9 2>/dev/null & e=$!
( . $S/env; ulimit -l unlimited; ulimit -r 99; exec /bin/sh $S/command ) </dev/null >/run/o 2>/run/e 8>&- 9>&-
status=$?
# Wait for the last output, but not for daemons that the command left behind.
n=0; while { kill -0 $o || kill -0 $e; } 2>/dev/null && [ $n -lt 30 ]; do sleep 0.1; n=$((n+1)); done
for o in $OUT $ERR; do case $o in /dev/tty*) stty -F $o raw;; esac; done
end $status
"""


@contextlib.contextmanager
def state_folder() -> Iterator[Path]:
    """A folder for what host and guest tell each other; short, for it becomes the path of sockets."""
    with tempfile.TemporaryDirectory(prefix="crux-can.", dir="/tmp") as folder:
        yield Path(folder)


def write_guest_files(state: Path, job: Job, modules: list[str], output: str, error: str) -> Path:
    """Writes the guest's scripts; `output` and `error` are its two serial lines. Returns the first process."""
    environment = {name: value for name, value in os.environ.items() if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name)}
    environment |= {"TMPDIR": "/run/tmp", "CRUX_CAN_GUEST": "1"}
    exports = [f"export {name}={shlex.quote(value)}\n" for name, value in environment.items()]
    (state / "env").write_text("".join(line for line in exports if line.split()[1].split("=")[0] not in NOT_PASSED_ON))
    (state / "command").write_text(
        f"cd {shlex.quote(str(Path.cwd()))} || exit {NO_KERNEL}\nexec {shlex.join(job.command)}\n"
    )
    power_off = f"{shlex.quote(sys.executable)} -I -S -c 'import ctypes; ctypes.CDLL(None).reboot(0x4321fedc)'"
    words = {
        "STATE": str(state),
        "OUT": output,
        "ERR": error,
        "MODULES": " ".join(modules),
        "INTERFACES": interface_script(job.interfaces),
        "POWER_OFF": power_off,
    }
    script = _FIRST_PROCESS
    for word, text in words.items():
        script = script.replace(f"@{word}@", text)
    first = state / "first"
    first.write_text(script)
    first.chmod(0o755)
    return first


def _pump(source: int, target: int) -> None:
    while data := os.read(source, 1 << 16):
        while data:
            try:
                data = data[os.write(target, data) :]
            except BlockingIOError:
                time.sleep(POLL_S)
            except OSError:
                return


def _own_process_namespace() -> list[str]:
    """What makes a process-id namespace, which ends with its first process; nothing where that is not permitted."""
    words = ["unshare", "--pid", "--fork", "--kill-child", "--"]
    try:
        permitted = (
            os.geteuid() == 0 and subprocess.run([*words, "true"], capture_output=True, check=False).returncode == 0
        )
    except OSError:
        permitted = False
    return words if permitted else []


class _Process:
    """The guest's process; whatever happens, nothing of it outlives the with-block."""

    def __init__(self, arguments: list[str], environment: dict[str, str], keep_open: tuple[int, ...]) -> None:
        arguments = ["setpriv", "--pdeathsig", "KILL", *_own_process_namespace(), *arguments]  # not to outlive us
        read_out, write_out = os.pipe()
        read_err, write_err = os.pipe()
        try:
            self.process = subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=write_out,
                stderr=write_err,
                env=environment,
                start_new_session=True,
                pass_fds=keep_open,
            )
        except OSError as error:
            raise NoKernel(f"cannot start {arguments[0]}: {error.strerror}") from error
        finally:
            os.close(write_out)
            os.close(write_err)
        pairs = ((read_out, 1), (read_err, 2))
        self._pumps = [threading.Thread(target=_pump, args=pair, daemon=True) for pair in pairs]
        for pump in self._pumps:
            pump.start()

    def __enter__(self) -> _Process:
        self._handlers = {
            number: signal.signal(number, self._on_signal) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        }
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        self._end()
        raise SystemExit(128 + number)

    def _end(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for pump in self._pumps:
            pump.join(5)


def run_guest(
    state: Path,
    job: Job,
    arguments: list[str],
    environment: dict[str, str],
    boot_s: float,
    keep_open: tuple[int, ...] = (),
) -> int:
    """Runs a guest prepared by `write_guest_files`; returns the command's status. Raises NoKernel."""
    began_s = time.monotonic()
    booted_s: float | None = None
    with _Process(arguments, environment, keep_open) as guest:
        while guest.process.poll() is None:
            now_s = time.monotonic()
            if booted_s is None and (state / "booted").exists():
                booted_s = now_s
            if booted_s is None and now_s - began_s > boot_s:
                raise NoKernel(f"the guest did not start within {boot_s:.0f} s{console_tail(state)}")
            if booted_s is not None and now_s - booted_s > job.timeout_s:
                note(f"crux can run: the command was ended after {job.timeout_s:g} s (--timeout)")
                return TIMED_OUT
            time.sleep(POLL_S)
    if job.verbose:
        start = f"{booted_s - began_s:.1f} s" if booted_s is not None else "not seen"
        note(f"crux can run: start of the kernel {start}, all {time.monotonic() - began_s:.1f} s")
    return _status(state)


def _status(state: Path) -> int:
    try:
        return int((state / "status").read_text())
    except (OSError, ValueError):
        raise NoKernel(f"the guest ended before the command did{console_tail(state)}") from None


def console_tail(state: Path) -> str:
    """The end of the guest's console, for an error message."""
    try:
        text = (state / "console").read_bytes()[-CONSOLE_SHOWN:].decode(errors="replace").strip()
    except OSError:
        return ""
    return f"; its console ends:\n{text}" if text else ""
