"""The kernel's ISO-TP and the nodes' understand each other: messages of one and of many frames, both ways."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from crux_contracts.node_parameters import table
from crux_contracts.node_services import number
from crux_tools.paths import ROOT
from with_can import BUSES, can_run

SCRIPT = Path(__file__).with_name("kernel_isotp.py")


def test_the_kernel_s_isotp_reads_parameters_and_sends_long_requests() -> None:
    path = os.pathsep.join([*(p for p in sys.path if p), str(ROOT / "firmware/ports/host")])
    done = can_run(
        "--virtual-time", "-i", BUSES, "--", sys.executable, str(SCRIPT),
        env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr.decode()
    answers = json.loads(done.stdout)
    names = [bytes.fromhex(answer)[21:].split(b"\0")[0].decode() for answer in answers["descriptions"]]
    assert names == [parameter.name for parameter in table()["joint"]]
    refused = bytes([number("service", "REFUSED"), number("service", "WRITE"), number("refusal", "LENGTH")])
    assert answers["long"] == [refused.hex()] * 5
