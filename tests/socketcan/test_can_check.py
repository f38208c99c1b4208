"""`crux can up` and `crux can check` on interfaces of a real kernel, with a load that is known."""

from __future__ import annotations

import json
import shlex
import sys

import pytest
from crux_contracts.robot import load_robot
from crux_tools.can.bus_load import frame_time_s
from with_can import CRUX, can_run

READS_ALL = "--inh-caps +dac_read_search --ambient-caps +dac_read_search"  # the project may lie in root's home
PERIOD_S, LENGTH, SECONDS = 0.001, 16, 2.0
# In one process: each start takes a second in the guest.
COMMANDS = f"""
import subprocess, sys
from crux_tools.cli import main
main(["can", "check", "--json", "can0", "can1"])
assert main(["can", "up", "can0", "can1"]) == 0
load = subprocess.Popen("cangen can0 -b -g {PERIOD_S * 1e3:g} -I 181 -L {LENGTH}".split())
main(["can", "check", "--json", "--measure", "{SECONDS:g}", "can0", "can1"])
load.kill()
"""


def test_up_check_and_measured_load() -> None:
    script = f"""
ip link set can1 down; ip link set can1 mtu 16
{shlex.join([sys.executable, "-c", COMMANDS])} 2>&1 || exit 9
setpriv --reuid 65534 {READS_ALL} {shlex.join(CRUX)} can up can0 2>&1
"""
    done = can_run("--virtual-time", "-i", "can0,can1", "--", "sh", "-c", script)
    before, up, after, no_root = done.stdout.decode().splitlines()
    (well, broken) = json.loads(before)["interfaces"]
    assert not json.loads(before)["ok"]
    assert well["problems"] == []
    assert broken["problems"] == ["it is down", "it does not carry CAN FD: mtu 16, right is 72"]
    assert up == "up: can0, can1"
    result = json.loads(after)
    assert result["ok"]
    can = load_robot("scaler").can
    least, most = frame_time_s(LENGTH, can.bit_rate, can.data_bit_rate)
    busy, idle = (interface["load"] for interface in result["interfaces"])
    assert busy["frames_Hz"] == pytest.approx(1 / PERIOD_S, rel=0.1)  # cangen's timer is coarse
    assert busy["least"] == pytest.approx(least * busy["frames_Hz"])
    assert busy["most"] == pytest.approx(most * busy["frames_Hz"])
    assert idle == {"least": 0.0, "most": 0.0, "frames_Hz": 0.0}
    assert "needs root; run there: ip link set can0 down && " in no_root
