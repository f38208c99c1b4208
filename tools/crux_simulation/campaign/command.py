"""`crux campaign`: plan, check, climb and judge by the thousand."""

from __future__ import annotations

import argparse
import json
import os
from collections import Counter
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught, whole
from crux_tools.output import add_json_option, alone_with, note, print_json

_DESCRIPTION = """Plans, checks, climbs and judges walls x worlds x seeds x methods as SPEC.yaml says, on a Dask
cluster: on this machine, one process a core, or on the cluster at --dask. Results are kept in DIR; after an
interruption the same command continues. More workers may join with the command that is printed. Other users cannot
use this machine's cluster; a cluster at --dask without TLS runs programs for anyone who reaches it.
DIR/results.parquet has one row for each job, DIR/failures/KEY all files of a job that failed, with the commands to
run it again. Exit status 0: every job has its result, good or bad. examples/campaign.yaml has every key of the
spec."""
_EXAMPLES = (
    "crux campaign examples/four-hold-walls.yaml --out out/walls",
    "crux campaign SPEC.yaml --out out/walls --dask tls://192.168.1.20:8786 --dask-keys cluster.pem",
    "crux report out/walls -o out/walls.html",
)


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux campaign`."""
    parser = subparsers.add_parser(
        "campaign", help="plan and climb thousands of walls, on a cluster", **taught(_DESCRIPTION, *_EXAMPLES)
    )
    parser.add_argument("spec", type=Path, metavar="SPEC.yaml", help="what to run")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where the results go, and are found")
    add_cluster_options(parser)
    parser.add_argument(
        "--keep", choices=["failures", "all"], default="failures", help="whose files to keep (default: %(default)s)"
    )
    add_json_option(parser)
    parser.set_defaults(func=run)


def add_cluster_options(parser: argparse.ArgumentParser) -> None:
    """Where jobs run."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--dask", metavar="ADDRESS", help="a running Dask scheduler, such as tls://HOST:8786")
    where.add_argument(
        "--workers",
        type=whole(0),
        default=len(os.sched_getaffinity(0)),
        metavar="N",
        help="processes on this machine otherwise (default: one a core, %(default)s here)",
    )
    parser.add_argument(
        "--dask-keys",
        type=Path,
        metavar="FILE.pem",
        help="keys for that scheduler: a certificate, its key, and the certificate that signs the cluster's",
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every job has its result."""
    from crux_contracts.output_file import look_at_folder, write_whole
    from crux_tools.report.results import ERROR, read_rows

    from crux_simulation.campaign.cluster import cluster
    from crux_simulation.campaign.engine import run_jobs
    from crux_simulation.campaign.environment import environment
    from crux_simulation.campaign.spec import read_spec
    from crux_simulation.campaign.store import TABLE, Store

    campaign = read_spec(options.spec)
    look_at_folder("--out", options.out)
    store = Store(options.out, keep_all=options.keep == "all")
    with alone_with(options.out), cluster(options.dask, options.dask_keys, options.workers) as running:
        scheduler = running.client.scheduler.address
        about = {"name": campaign.name, "jobs": len(campaign.jobs), "scheduler": scheduler} | environment()
        write_whole(options.out / "campaign.json", json.dumps(about).encode())
        note(f"campaign {campaign.name}: {len(campaign.jobs)} jobs")
        note(f"workers may join: {running.join}")
        run_jobs(campaign.jobs, store, running.client, f"campaign {campaign.name}")
    keys = {job.key for job in campaign.jobs}
    verdicts = Counter(row["verdict"] for row in read_rows(options.out) if row["key"] in keys)
    if options.json:
        counts = {"jobs": len(keys), "verdicts": dict(verdicts), "table": str(options.out / TABLE)}
        print_json({"ok": not verdicts[ERROR], "scheduler": scheduler, **counts})
    else:
        note(f"{', '.join(f'{count} {verdict}' for verdict, count in verdicts.most_common())}; {options.out / TABLE}")
    return 1 if verdicts[ERROR] else 0
