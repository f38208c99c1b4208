"""The runtime's SocketCAN back-end on a real kernel: tests/runtime/shell/socketcan_test.cpp inside `crux can run`."""

from __future__ import annotations

import re

from crux_tools.paths import built
from with_can import can_run


def test_back_end_on_a_real_kernel() -> None:
    done = can_run("--virtual-time", "--", str(built("tests/runtime/shell/socketcan_tests")))
    text = done.stdout.decode()
    assert done.returncode == 0, text + done.stderr.decode()
    ran = re.search(r"\[  PASSED  \] (\d+) tests", text)
    assert ran is not None
    assert int(ran.group(1)) >= 8
