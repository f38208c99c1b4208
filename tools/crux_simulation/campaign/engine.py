"""Jobs on a Dask cluster, each until its result is in the store; whatever is killed meanwhile, the rest is run again.

Dask runs a job again whose worker is lost. Nothing of a campaign is kept in scheduler or workers: this process alone
writes into the store, so the workers need no file system in common.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from crux_tools.errors import WorkFailed
from crux_tools.output import alone_with, note, progress
from crux_tools.report.results import ERROR, Row, read_rows
from distributed import CancelledError, Client, as_completed, get_worker
from distributed.comm import CommClosedError

from crux_simulation.campaign.cluster import cluster
from crux_simulation.campaign.environment import Environment, differences, environment
from crux_simulation.campaign.job import Outcome
from crux_simulation.campaign.store import Store

RETRIES = 1  # of a job that ends with an error
HANGING_S = 3600.0  # by the clock: a worker is ended whose job takes so long
ONE_AT_A_TIME = threading.Lock()  # in a process: the planner's time limits count all that its process computes


class Job(Protocol):
    """What runs on a worker."""

    @property
    def key(self) -> str:
        """Names its result."""

    def labels(self) -> dict[str, Any]:
        """The columns that say which job it is."""

    def run(self) -> Outcome:
        """Does it."""


@dataclass
class Done:
    """What comes back from a worker."""

    outcome: Outcome
    worker: str
    environment: Environment


def run_on_worker(job: Job, keep_all: bool) -> Done:
    """Runs a job where this is called, and says where that is and what it cost."""
    with ONE_AT_A_TIME:
        before = _cpu_s()
        faulthandler.dump_traceback_later(HANGING_S, exit=True)
        try:
            outcome = job.run()
        finally:
            faulthandler.cancel_dump_traceback_later()
        outcome.row["cpu_s"] = round(_cpu_s() - before, 3)
    if outcome.ok and not keep_all:
        outcome.files.clear()
    return Done(outcome, get_worker().address, environment())


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Watch:
    """Says, once a worker, where one differs from this process."""

    def __init__(self) -> None:
        self.said: dict[str, str] = {}

    def look(self, worker: str, there: Environment) -> str:
        """How it differs, empty where it does not."""
        if worker not in self.said:
            self.said[worker] = differences(environment(), there)
            if self.said[worker]:
                note(f"worker {worker} differs: {self.said[worker]}")
        return self.said[worker]

    def look_at_all(self, client: Client) -> None:
        """The workers that are there now; raises WorkFailed where one has no crux."""
        try:
            for worker, there in client.run(environment, on_error="raise").items():
                self.look(worker, there)
        except ImportError as error:
            raise WorkFailed(f"a worker cannot import crux ({error}): start it in crux's environment") from None


def run_jobs(jobs: Sequence[Job], store: Store, client: Client, title: str) -> None:
    """Runs what the store does not have yet; the table is written at the end, however that comes.

    Raises WorkFailed where the scheduler is lost; a job that ends with an error leaves a row that says so.
    """
    watch, finished = Watch(), store.finished()
    by_key = {job.key: job for job in jobs}
    missing = [job for key, job in by_key.items() if key not in finished]
    try:
        watch.look_at_all(client)
        futures = [client.submit(run_on_worker, job, store.keep_all, key=job.key, retries=RETRIES) for job in missing]
        with progress(title, len(by_key)) as bar:
            done = len(by_key) - len(missing)
            bar.at(done)
            for future in as_completed(futures):
                store.put(_outcome(future, by_key, watch))
                future.release()
                done += 1
                bar.at(done)
    except (CancelledError, CommClosedError):
        raise WorkFailed("the scheduler is lost; what is done is kept: give the same command again") from None
    finally:
        store.write_table()


def run_anew(jobs: Sequence[Job], folder: Path, options: argparse.Namespace, title: str) -> list[Row]:
    """The rows of jobs, in their order, whatever `folder` has had of them; `options`: those of add_cluster_options.

    Raises WorkFailed where a job ended with an error.
    """
    store = Store(folder)
    store.clear()
    with alone_with(folder), cluster(options.dask, options.dask_keys, options.workers) as running:
        run_jobs(jobs, store, running.client, title)
    rows = {row["key"]: row for row in read_rows(folder)}
    for row in rows.values():
        if row["verdict"] == ERROR:
            raise WorkFailed(f"{title}: job {row['key']}: {row['reason']}")
    return [rows[job.key] for job in jobs]


def _outcome(future: Any, by_key: dict[str, Job], watch: Watch) -> Outcome:
    try:
        done: Done = future.result()
    except (CancelledError, CommClosedError):
        raise
    except Exception as error:  # the job's own, or its workers were lost again and again
        job = by_key[future.key]
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Outcome({"key": future.key, **job.labels(), "verdict": ERROR, "reason": reason})
    done.outcome.row["worker"] = done.worker
    done.outcome.row["commit"] = done.environment["commit"]
    done.outcome.row["differs"] = watch.look(done.worker, done.environment)
    return done.outcome
