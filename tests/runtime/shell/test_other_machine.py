"""LCM with ttl=0 is this machine's alone, both ways: two network namespaces, joined as two machines by a cable."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from crux_contracts import LIMB_NAMES
from crux_tools.paths import built
from own_runtime import ROBOT

GROUP = "udpm://239.255.76.67:7667"
BUSES = [f"udp:239.74.163.2:{port}" for port in range(43113, 43117)]
SEND = """
import sys
from crux_msgs import command_t
from crux_tools.operator_link import OperatorLink
link = OperatorLink(sys.argv[1])
answer = link.command(command_t.STATUS, tries=int(sys.argv[2]))
print("answered" if answer else "silence")
"""
SHUT_DOWN = """
import sys, lcm
from crux_contracts import channels
from crux_msgs import command_t
message = command_t()
message.command = command_t.FORCE_SHUTDOWN
for _ in range(20):
    lcm.LCM(sys.argv[1]).publish(channels.CRUX_COMMAND, message.encode())
"""

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="network namespaces are root's to make")


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@pytest.fixture
def machines() -> Iterator[tuple[str, str]]:
    """The robot's and another one; multicasts of both take the cable."""
    names = f"crux-robot-{os.getpid()}", f"crux-other-{os.getpid()}"
    with ExitStack() as stack:
        for name in names:
            ip("netns", "add", name)
            stack.callback(ip, "netns", "del", name)
        ends = f"cr{os.getpid()}a", f"cr{os.getpid()}b"
        ip("link", "add", ends[0], "netns", names[0], "type", "veth", "peer", "name", ends[1], "netns", names[1])
        for number, (name, end) in enumerate(zip(names, ends, strict=True), start=1):
            ip("-n", name, "addr", "add", f"10.77.0.{number}/24", "dev", end)
            for link in (end, "lo"):
                ip("-n", name, "link", "set", link, "up")
            ip("-n", name, "route", "add", "224.0.0.0/4", "dev", end)
        yield names


def python_in(machine: str, program: str, *words: str) -> str:
    command = ["ip", "netns", "exec", machine, sys.executable, "-c", program, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=600).stdout.strip()


@pytest.mark.parametrize("ttl", [0, 1])
def test_another_machine_ends_a_runtime_only_where_lcm_leaves_the_machine(machines: tuple[str, str], ttl: int) -> None:
    robot, other = machines
    command = ["ip", "netns", "exec", robot, str(built("runtime/app/crux-runtime")), "--insecure"]
    command += ["--robot", str(ROBOT), "--lcm", f"{GROUP}?ttl={ttl}"]
    command += [word for limb, bus in zip(LIMB_NAMES, BUSES, strict=True) for word in ("--bus", f"{limb}={bus}")]
    with ExitStack() as stack:
        runtime = stack.enter_context(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
        stack.callback(runtime.kill)
        assert python_in(robot, SEND, f"{GROUP}?ttl=0", "40") == "answered"
        python_in(other, SHUT_DOWN, f"{GROUP}?ttl=1")
        if ttl:
            assert runtime.wait(600) == 0  # so what was sent does arrive
        else:
            assert python_in(robot, SEND, f"{GROUP}?ttl=0", "4") == "answered"
            assert python_in(other, SEND, f"{GROUP}?ttl=1", "1") == "silence"
            assert runtime.poll() is None
