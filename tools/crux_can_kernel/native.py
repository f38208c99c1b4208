"""The host's own SocketCAN: a network namespace of the job's own, with the virtual interfaces it asks for.

A process namespace besides ends whatever the command leaves behind.
"""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

from crux_tools.output import note

from crux_can_kernel.job import TIMED_OUT, Job, NoKernel, interface_script


def available() -> bool:
    """This kernel has CAN sockets."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def run(job: Job, state: Path) -> int:
    """Runs the job on this kernel. Raises NoKernel where the interfaces cannot be made."""
    script = state / "native"
    lines = ["ip route add 224.0.0.0/4 dev lo || exit 125", f": >{state}/booted", '"$@"', "exit $?"]
    script.write_text(interface_script(job.interfaces) + "\n".join(lines) + "\n")
    as_root = [] if os.geteuid() == 0 else ["--map-root-user"]
    # No exec in the script: the first process of a namespace does not feel signals.
    namespaces = ["--net", "--pid", "--fork", "--kill-child", "--mount-proc"]
    command = ["unshare", *as_root, *namespaces, "--", "sh", str(script), *job.command]
    process = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", *command], stdin=subprocess.DEVNULL)
    try:
        status = process.wait(job.timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        note(f"crux can run: the command was ended after {job.timeout_s:g} s (--timeout)")
        return TIMED_OUT
    if not (state / "booted").exists():
        raise NoKernel("this kernel has CAN sockets, but no virtual interfaces can be made (module vcan, rights)")
    return 128 - status if status < 0 else status
