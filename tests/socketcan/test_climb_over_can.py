"""The whole climb over SocketCAN: runtime, four CAN FD interfaces, firmware nodes, physics, at 500 Hz by the clock.

Virtual time makes it repeatable: what two runs put on the buses is the same to the bit and the microsecond.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from crux_contracts.plan_file import write_plan
from crux_tools.telemetry import read_log
from hand_plan import Wall, standing_plan
from mcap.reader import make_reader
from short_climb import plan_short_climb
from with_can import BUSES, CRUX, can_run

SETTLED_CYCLES = 100
_RECORD = """
cd "$1"; candump -l can0 can1 can2 can3 >/dev/null & dump=$!
sleep 0.2
shift
"$@"; status=$?
sleep 0.5; kill -INT $dump; wait $dump
exit $status
"""
Run = tuple[subprocess.CompletedProcess[bytes], Path, Path]


def _climb(folder: Path, plan: Path, number: int) -> Run:
    dump, log = folder / f"dump{number}", folder / f"log{number}.mcap"
    dump.mkdir()
    climb = [*CRUX, "climb", str(plan), "-o", str(log), "--bus", "socketcan", "--pace", "realtime", "--json"]
    done = can_run("--virtual-time", "-i", BUSES, "--", "sh", "-c", _RECORD, "sh", str(dump), *climb)
    (file,) = dump.glob("candump-*.log")
    return done, file, log


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One climb."""
    folder = tmp_path_factory.mktemp("climb")
    return _climb(folder, plan_short_climb(folder), 1)


def test_in_lockstep_the_log_is_that_of_one_process(tmp_path: Path) -> None:
    plan = tmp_path / "plan.mcap"
    write_plan(plan, standing_plan(Wall(dt_s=1.0)))
    logs = {bus: tmp_path / f"{bus}.mcap" for bus in ("socketcan", "memory")}
    words = {bus: [*CRUX, "climb", str(plan), "-o", str(log), "--bus", bus] for bus, log in logs.items()}
    over_can = can_run("--virtual-time", "-i", BUSES, "--", *words["socketcan"])
    assert over_can.returncode == 0, over_can.stderr.decode()
    subprocess.run(words["memory"], check=True, capture_output=True)
    socketcan, memory = map(_messages, logs.values())
    assert len(memory) > 5_000
    assert socketcan == memory


def _messages(log: Path) -> list[tuple[str, int, bytes]]:
    """Everything in a log, in its order, but what carries wall time."""
    with log.open("rb") as stream:
        messages = make_reader(stream).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.data) for _, c, m in messages if c.topic != "/cycle_timing"]


def test_reaches_the_goal_without_a_missed_cycle(run: Run) -> None:
    done = run[0]
    assert done.returncode == 0, done.stderr.decode()
    result = json.loads(done.stdout)
    assert result["ok"]
    assert result["reached_goal"]
    assert result["missed_cycles"] == 0
    assert 0.99 < result["real_time_factor"] < 1.01


@pytest.mark.sweep
def test_two_runs_put_the_same_on_the_buses(run: Run, tmp_path: Path) -> None:
    again = _climb(tmp_path, plan_short_climb(tmp_path), 2)
    hashes = {hashlib.sha256(dump.read_bytes()).hexdigest() for _, dump, _ in (run, again)}
    assert len(hashes) == 1
    assert json.loads(again[0].stdout)["ok"]


def test_every_cycle_has_its_frames_on_every_bus(run: Run) -> None:
    """16 frames a cycle and bus: 7 commands, Sync, 7 statuses, force/torque."""
    counts: Counter[tuple[str, str]] = Counter()
    for line in run[1].read_text().splitlines():
        _, bus, frame = line.split()
        identifier, _, payload = frame.partition("##")
        assert payload[0] == "5", f"not CAN FD with bit rate switch: {line}"  # FDF | BRS
        counts[bus, identifier] += 1
    cycles = json.loads(run[0].stdout)["cycles"]
    per_cycle = [f"{base + node:03X}" for base in (0x100, 0x180) for node in range(1, 8)] + ["010", "1C7"]
    for bus in BUSES.split(","):
        for identifier in per_cycle:
            assert cycles <= counts[bus, identifier] <= cycles + SETTLED_CYCLES, (bus, identifier)


def test_the_log_says_that_the_buses_were_well(run: Run) -> None:
    log = read_log(run[2])
    assert (log.inputs["bus_state"] == 0).all()
    assert set(log.buses["limb"]) == {0, 1, 2, 3}
    for count in ("error_frames", "queue_full", "send_failed", "receive_lost", "crc_errors", "repeated", "foreign"):
        assert (log.buses[count] == 0).all(), count
