"""A campaign of jobs that do nothing but say that they ran, and wait until they may end.

python tiny_campaign.py FOLDER COUNT [ADDRESS [KEYS]]: results go to FOLDER/out; on a worker of its own, or those at
ADDRESS. FOLDER/address gets the scheduler's, FOLDER/join the command by which a worker joins. FOLDER/ran/NAME gets a
line with the process id whenever that job begins; it ends when FOLDER/go/NAME is there.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_simulation.campaign.cluster import cluster
from crux_simulation.campaign.engine import run_jobs
from crux_simulation.campaign.job import Outcome
from crux_simulation.campaign.store import Store
from crux_tools.report.results import CLIMBED, FAILED

POLL_S = 0.02


@dataclass(frozen=True)
class TinyJob:
    """One of them; the one of name "0" fails."""

    name: str
    folder: Path

    @property
    def key(self) -> str:
        """Its name."""
        return f"tiny-{self.name}"

    def labels(self) -> dict[str, Any]:
        """As of a climb."""
        return {"walls": "tiny", "wall_seed": int(self.name), "world": "nominal", "seed": 0, "method": "none"}

    def run(self) -> Outcome:
        """Says that it runs, and waits."""
        with (self.folder / "ran" / self.name).open("a") as ran:
            ran.write(f"{os.getpid()}\n")
        while not (self.folder / "go" / self.name).exists():
            time.sleep(POLL_S)
        verdict = FAILED if self.name == "0" else CLIMBED
        return Outcome({"key": self.key, **self.labels(), "verdict": verdict, "reason": ""}, {"log.mcap": b"log"})


def main(folder: Path, count: int, address: str | None = None, keys: str | None = None) -> None:
    """The campaign."""
    jobs = [TinyJob(str(number), folder) for number in range(count)]
    with cluster(address, None if keys is None else Path(keys), 1) as running:
        (folder / "join").write_text(running.join)
        (folder / "address").write_text(running.client.scheduler.address)
        run_jobs(jobs, Store(folder / "out"), running.client, "tiny jobs")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
