"""What writing the log costs, and what a kill or a power cut leaves of it, by readers that are none of ours."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from crux_tools.paths import built
from crux_tools.telemetry import read_channels
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

TOPIC = "/control_output"
CYCLES = 300  # a flush: so much that the file grows every third time
CDR_HEADER = 4


def write_log(log: Path, flushes: int, cycles: int, steps: Path | None = None) -> int:
    """A log of `flushes` flushes of `cycles` cycles; how many bytes went into its file. `steps`: see log_steps.cpp."""
    program = built("tests/runtime/shell/log_steps")
    more = [str(steps)] if steps else []
    done = subprocess.run([program, log, str(flushes), str(cycles), *more], capture_output=True, check=True)
    return int(done.stdout)


def test_twice_the_records_cost_twice_the_bytes(tmp_path: Path) -> None:
    written = {flushes: write_log(tmp_path / f"{flushes}.mcap", flushes, cycles=10) for flushes in (300, 600)}
    assert written[600] / written[300] == pytest.approx(2, rel=0.05)
    assert written[600] < 1.05 * (tmp_path / "600.mcap").stat().st_size


def cycles_by_crux(log: Path) -> list[int]:
    return [int(cycle) for cycle in read_channels(log, {TOPIC}).tables[TOPIC]["cycle"]]


def cycle_of(payload: bytes) -> int:
    return int(struct.unpack_from("<q", payload, CDR_HEADER)[0])


def cycles_by_mcap(log: Path) -> list[int]:
    with log.open("rb") as file:
        return [cycle_of(message.data) for _, _, message in make_reader(file).iter_messages(topics=[TOPIC])]


def cycles_by_rosbags(log: Path) -> list[int]:
    with AnyReader([log]) as reader:
        return [cycle_of(payload) for _, _, payload in reader.messages()]


@pytest.mark.parametrize("cycles_by", [cycles_by_crux, cycles_by_mcap, cycles_by_rosbags])
def test_a_log_is_whole_at_any_time(cycles_by: Callable[[Path], list[int]], steps: list[Path]) -> None:
    for step in steps:
        flushed = int(step.stem.split("-")[1])
        if flushed or cycles_by is not cycles_by_rosbags:  # which opens no bag without a message
            cycles = cycles_by(step)
            assert cycles == list(range(1, len(cycles) + 1)), step.name
            assert flushed <= len(cycles) <= flushed + CYCLES, step.name


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The file in the middle of every write and after it, over some twelve flushes and several growths of the file."""
    folder = tmp_path_factory.mktemp("steps")
    write_log(folder / "log.mcap", 12, CYCLES, folder)
    return sorted(folder.glob("*-*.mcap"))
