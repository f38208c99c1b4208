"""Doors that are shut: a second runtime beside the first one."""

from __future__ import annotations

import subprocess

import pytest
from crux_contracts import LIMB_NAMES
from crux_simulation.sim.ports import run_ports
from crux_tools.paths import built
from own_runtime import END_TIMEOUT_S, ROBOT, Runtime, Starter


@pytest.mark.parametrize("shared", ["lcm", "bus"])
def test_a_second_runtime_is_refused(start: Starter, shared: str) -> None:
    first: Runtime = start()
    with run_ports() as other:
        lcm_url = first.ports.lcm_url if shared == "lcm" else other.lcm_url
        buses = first.ports.bus_urls() if shared == "bus" else other.bus_urls()
        words = [word for name, url in zip(LIMB_NAMES, buses, strict=True) for word in ("--bus", f"{name}={url}")]
        command = [str(built("runtime/app/crux-runtime")), "--insecure", "--robot", str(ROBOT), "--lcm", lcm_url]
        command += words
        second = subprocess.run(command, capture_output=True, text=True, timeout=END_TIMEOUT_S, check=False)
    assert second.returncode == 2
    assert "another crux-runtime has it" in second.stderr
    assert (lcm_url if shared == "lcm" else buses[0]) in second.stderr


def test_what_a_killed_runtime_had_is_free(start: Starter) -> None:
    first = start()
    first.process.kill()
    first.process.wait()
    start(ports=first.ports)  # which waits for its answer
