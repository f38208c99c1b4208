"""`crux campaign` against kill -9 of whoever takes part, other workers, wrong specs, and closed forms."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

import pytest
from crux_tools.campaign.store import read_rows
from pyarrow import parquet

HERE = Path(__file__).resolve().parent
SCRIPTS = Path(sys.executable).parent
LONGEST_S = 120.0
POLL_S = 0.05


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """For tiny_campaign.py."""
    for name in ("ran", "go", "out"):
        (tmp_path / name).mkdir()
    return tmp_path


def wait_for(there: Callable[[], bool]) -> None:
    """Until it is so; a test that waits for ever fails."""
    end_s = time.monotonic() + LONGEST_S
    while not there():
        assert time.monotonic() < end_s, "it never came"
        time.sleep(POLL_S)


@contextmanager
def started(*words: str | Path, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A Python program that is ended with the block, if it has not ended by then."""
    process = subprocess.Popen(
        [sys.executable, *map(str, words)],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(HERE)} | environment,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def campaign(folder: Path, count: int, *address: str) -> AbstractContextManager[subprocess.Popen[str]]:
    return started(HERE / "tiny_campaign.py", folder, str(count), *address)


def let(folder: Path, *names: str) -> None:
    for name in names:
        (folder / "go" / name).touch()


def ran(folder: Path, name: str) -> list[int]:
    """The processes in which a job began."""
    file = folder / "ran" / name
    return [int(line) for line in file.read_text().splitlines()] if file.exists() else []


def rows(folder: Path) -> list[str]:
    return [row["key"] for row in read_rows(folder / "out")]


def ended(process: subprocess.Popen[str]) -> str:
    """What it said on standard error."""
    said = process.communicate(timeout=LONGEST_S)[1]
    assert process.returncode == 0, said
    return said


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_worker_killed_in_mid_job_is_replaced_and_its_job_run_again(folder: Path) -> None:
    let(folder, "0", "2")
    with campaign(folder, 3) as client:
        wait_for(lambda: len(ran(folder, "1")) == 1)
        os.kill(ran(folder, "1")[0], signal.SIGKILL)
        wait_for(lambda: len(ran(folder, "1")) == 2)
        let(folder, "1")
        ended(client)
    assert rows(folder) == ["tiny-0", "tiny-1", "tiny-2"]
    assert parquet.read_table(folder / "out" / "results.parquet")["key"].to_pylist() == rows(folder)


def test_a_killed_campaign_goes_on_where_it_was(folder: Path) -> None:
    let(folder, "0")
    with campaign(folder, 3) as client:
        wait_for(lambda: ran(folder, "1") != [] and rows(folder) == ["tiny-0"])
        client.kill()
        wait_for(lambda: not alive(ran(folder, "1")[0]))
    let(folder, "1", "2")
    with campaign(folder, 3) as client:
        ended(client)
    assert rows(folder) == ["tiny-0", "tiny-1", "tiny-2"]
    assert [len(ran(folder, name)) for name in "012"] == [1, 2, 1]
    assert (folder / "out" / "failures" / "tiny-0" / "log.mcap").read_bytes() == b"log"
    assert not (folder / "out" / "successes").exists()


def test_a_worker_joins_by_address_in_mid_run_and_where_it_differs_is_said(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "crux_commit.py").write_text('COMMIT = "another"')
    with ExitStack() as stack:
        client = stack.enter_context(campaign(folder, 3))
        wait_for(lambda: ran(folder, "0") != [])
        words = (SCRIPTS / "dask", "worker", (folder / "address").read_text(), "--nthreads", "1", "--no-dashboard")
        stack.enter_context(started(*words, PYTHONPATH=f"{tmp_path / 'other'}:{HERE}"))
        let(folder, "1", "2")  # the only worker so far is busy with 0
        wait_for(lambda: rows(folder) == ["tiny-1", "tiny-2"])
        let(folder, "0")
        said = ended(client)
    results = {row["key"]: row for row in read_rows(folder / "out")}
    assert results["tiny-1"]["worker"] == results["tiny-2"]["worker"] != results["tiny-0"]["worker"]
    assert [results[f"tiny-{name}"]["commit"] == "another" for name in "012"] == [False, True, True]
    assert said.count("differs: commit another instead of") == 1
    assert results["tiny-0"]["differs"] == ""
    assert "commit another" in results["tiny-1"]["differs"]


def test_a_lost_scheduler_ends_the_campaign_in_one_line_and_keeps_what_is_done(folder: Path) -> None:
    scheduler_file = folder / "scheduler.json"
    let(folder, "0")
    with ExitStack() as stack:
        words = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", scheduler_file)
        scheduler = stack.enter_context(started(SCRIPTS / "dask", "scheduler", *words))
        wait_for(scheduler_file.exists)
        address = json.loads(scheduler_file.read_text())["address"]
        stack.enter_context(started(SCRIPTS / "dask", "worker", address, "--nthreads", "1", "--no-dashboard"))
        client = stack.enter_context(campaign(folder, 2, address))
        wait_for(lambda: ran(folder, "1") != [] and rows(folder) == ["tiny-0"])
        scheduler.kill()
        said = client.communicate(timeout=LONGEST_S)[1]
        let(folder, "1")
    assert "WorkFailed: the scheduler is lost; what is done is kept: give the same command again" in said
    assert "distributed" not in said
    assert parquet.read_table(folder / "out" / "results.parquet")["key"].to_pylist() == ["tiny-0"]
