"""Doors that are shut: a second runtime beside the first one."""

from __future__ import annotations

import subprocess

import pytest
from crux_contracts import LIMB_NAMES
from crux_tools.bench.ports import run_ports
from crux_tools.paths import built
from own_runtime import ROBOT, Runtime, Starter


def start_beside(lcm_url: str, buses: list[str], timeout_s: float = 20) -> tuple[int, str]:
    words = [word for name, url in zip(LIMB_NAMES, buses, strict=True) for word in ("--bus", f"{name}={url}")]
    command = [str(built("runtime/app/crux-runtime")), "--robot", str(ROBOT), "--lcm", lcm_url, *words]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
    return ended.returncode, ended.stderr


@pytest.mark.parametrize("shared", ["lcm", "bus"])
def test_a_second_runtime_is_refused(start: Starter, shared: str) -> None:
    first: Runtime = start()
    with run_ports() as other:
        lcm_url = first.ports.lcm_url if shared == "lcm" else other.lcm_url
        buses = first.ports.bus_urls() if shared == "bus" else other.bus_urls()
        status, stderr = start_beside(lcm_url, buses)
    assert status == 2
    assert "another crux-runtime has it" in stderr
    assert (lcm_url if shared == "lcm" else buses[0]) in stderr
    first.process.kill()
    first.process.wait()
    with pytest.raises(subprocess.TimeoutExpired):  # it runs: the kernel has freed the names of the killed one
        start_beside(first.ports.lcm_url, first.ports.bus_urls(), 0.5)
