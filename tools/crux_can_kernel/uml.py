"""User-mode Linux: the kernel as a process of the host. Needs no virtualisation and no rights beyond ptrace."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from crux_can_kernel.guest import run_guest, write_guest_files
from crux_can_kernel.job import Job
from crux_can_kernel.uml_kernel import kernel

BOOT_S = 120.0  # on a busy machine
EPOCH_NS = 1_577_836_800_000_000_000  # virtual time begins on 2020-01-01: later than any sane check, always the same


def _memory_folder(size_MiB: int) -> str:
    """Where the guest's memory is mapped from: /dev/shm unless a container has kept it small."""
    shared = "/dev/shm"
    if os.access(shared, os.W_OK) and shutil.disk_usage(shared).free >= size_MiB << 20:
        return shared
    return "/tmp"


def run(job: Job, state: Path) -> int:
    """Runs the job in our own kernel, which is built first when it is missing. Raises NoKernel."""
    executable = kernel()
    first = write_guest_files(state, job, [], "/dev/ttyS0", "/dev/ttyS1")
    environment = dict(os.environ, TMPDIR=_memory_folder(job.memory_MiB))
    console = os.open(state / "console", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    arguments = [
        str(executable),
        *(f"mem={job.memory_MiB}M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "rw", f"init={first}"),
        *(f"uml_dir={state}", "umid=guest", "con=null", f"con0=null,fd:{console}"),
        *("ssl=null", "ssl0=null,fd:1", "ssl1=null,fd:2"),
        *("quiet", "loglevel=3", "random.trust_cpu=on"),
    ]
    if job.virtual_time:
        arguments += ["time-travel=inf-cpu", f"time-travel-start={EPOCH_NS}"]
    try:
        return run_guest(state, job, arguments, environment, BOOT_S, keep_open=(console,))
    finally:
        os.close(console)
