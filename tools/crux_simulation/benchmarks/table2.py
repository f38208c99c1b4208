"""`crux bench table2`: the paper's Table II on this machine, every method on the same start and goal pairs.

Each run is a cold process of its own, one after the other. A run succeeds when a plan comes out within the time limit
and `crux check`, a process of its own again, passes it. P2a in the paper's form has no plan at its end: it succeeds
when HiGHS finds values that satisfy all its rows.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.output_file import look_at_folder
from crux_planner.errors import FOR_ITS_REACH
from crux_planner.method_report import METHODS_HERE
from crux_tools.arguments import positive, whole
from crux_tools.output import note, print_json, progress
from scipy import stats

from crux_simulation.benchmarks.cold_process import HANGING, crux_json, measured
from crux_simulation.benchmarks.pairs import TASKS, pair
from crux_simulation.benchmarks.setting import setting, setting_text

CONFIDENCE = 0.99
GRACE_S = 10.0  # beyond the time limit that P2a is given, before its process is ended
_WIDTH = 120  # characters of the table
PAPER_FORM = "paper_form"
METHODS = ("auto", "two_block", "multi_block", "benchmark", PAPER_FORM)
NAMES = {
    "auto": "auto",
    "two_block": "two-block ADMM",
    "multi_block": "five-block ADMM",
    "benchmark": "benchmark NLP",
    PAPER_FORM: "P2a in HiGHS",
}
PAPER = {
    ("walking", "benchmark"): "3275 s, 10 %",
    ("walking", "two_block"): "168 ± 50 s, 100 %",
    ("walking", "multi_block"): "44 ± 21 s, 100 %",
    ("climbing", "benchmark"): "none, 0 %",
    ("climbing", "two_block"): "619 ± 99 s, 100 %",
    ("climbing", "multi_block"): "970 ± 60 s, 90 %",
}


@dataclass(frozen=True)
class Run:
    """One method on one pair."""

    task: str
    seed: int
    method: str
    ok: bool
    seconds: float
    peak_MB: float
    cost: float | None
    gap: float | None
    remark: str
    details: dict[str, Any]


@dataclass(frozen=True)
class Row:
    """One method on one task: times are of the runs that succeeded."""

    task: str
    method: str
    runs: int
    successes: int
    mean_s: float | None
    half_width_s: float | None  # of the 99 % interval of the mean; None for fewer than two
    cost: float | None
    gap: float | None
    peak_MB: float
    remark: str
    converged: int | None  # of an ADMM: plans before which its blocks came within the paper's thresholds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench table2`."""
    parser.add_argument("--count", type=whole(1), default=10, metavar="N", help="pairs a task (default: %(default)s)")
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="of the first pair (default: %(default)s)"
    )
    parser.add_argument(
        "--time-limit", type=positive, default=30.0, metavar="S", help="of computing, for a run (default: %(default)g)"
    )
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS), metavar="TASK", help=", ".join(TASKS))
    parser.add_argument(
        "--methods", nargs="+", choices=METHODS, default=list(METHODS), metavar="M", help=", ".join(METHODS)
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-table2"), metavar="DIR", help="for scenarios, plans, the table"
    )


def run_one(task: str, seed: int, method: str, limit_s: float, folder: Path) -> Run:
    """A cold run; its files stay in `folder`."""
    scenario, plan = folder / f"{task}-{seed}.yaml", folder / f"{task}-{seed}.{method}.plan.mcap"
    scenario.write_text(pair(task, seed), encoding="utf-8")
    allowed = ("--time-limit", f"{limit_s:g}")
    if method == PAPER_FORM:
        done = measured("crux_planner.admm.paper_form", str(scenario), *allowed, limit_s=limit_s + GRACE_S)
        ok = bool(done.result.get("ok"))
    else:
        words = ("plan", str(scenario), "-o", str(plan), "--method", method, *allowed)
        done = measured("crux_tools.cli", *words, limit_s=HANGING * limit_s)
        ok = bool(done.result.get("ok")) and bool(crux_json("check", str(plan))[0].get("ok"))
    said = done.result
    remark = str(said.get("remark") or said.get("error") or "")
    kept = {key: value for key, value in said.items() if key not in ("history", "check")}
    return Run(task, seed, method, ok, done.seconds, done.peak_MB, said.get("cost"), said.get("gap"), remark, kept)


def row_of(runs: list[Run]) -> Row:
    """Runs of one method on one task, summed up."""
    good = [run for run in runs if run.ok]
    times = np.array([run.seconds for run in good])
    half = None
    if len(times) > 1:
        quantile = float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(times) - 1))
        half = quantile * float(times.std(ddof=1)) / len(times) ** 0.5
    costs = [run.cost for run in good if run.cost is not None]
    gaps = [run.gap for run in good if run.gap is not None]
    reports = [report for run in good if (report := run.details.get("method_report"))]
    return Row(
        task=runs[0].task,
        method=runs[0].method,
        runs=len(runs),
        successes=len(good),
        mean_s=float(times.mean()) if len(times) else None,
        half_width_s=half,
        cost=float(np.mean(costs)) if costs else None,
        gap=float(np.mean(gaps)) if gaps else None,
        peak_MB=max(run.peak_MB for run in runs),
        remark=next((run.remark for run in runs if not run.ok and run.remark), ""),
        converged=sum(bool(report.get("converged")) for report in reports) if reports else None,
    )


def time_text(row: Row) -> str:
    """Mean and interval, as the table shows them."""
    if row.mean_s is None:
        return "none"
    return f"{row.mean_s:.2f} s" if row.half_width_s is None else f"{row.mean_s:.2f} ± {row.half_width_s:.2f} s"


def _table(rows: list[Row]) -> Any:
    from rich.table import Table

    table = Table(title="Table II here and in the paper: mean of the successes ± 99 % interval (Student t)")
    for name in ("task", "method", "time", "success", "converged", "J", "gap", "peak memory", "paper"):
        table.add_column(name)
    for row in rows:
        table.add_row(
            row.task,
            NAMES[row.method],
            time_text(row),
            f"{100 * row.successes / row.runs:.0f} % of {row.runs}",
            "-" if row.converged is None else str(row.converged),
            "-" if row.cost is None else f"{row.cost:.2f}",
            "-" if row.gap is None else f"{100 * row.gap:.0f} %",
            f"{row.peak_MB:.0f} MB",
            PAPER.get((row.task, row.method), "-"),
        )
    return table


def _show(rows: list[Row], said: str, file: Path) -> None:
    from rich.console import Console

    table = _table(rows)
    with file.open("w", encoding="utf-8") as out:
        for console in (Console(stderr=True, width=_WIDTH), Console(file=out, width=_WIDTH)):
            console.print(table)
            console.print(
                f"gap: to a bound proven {FOR_ITS_REACH}\n{METHODS_HERE}\n{said}", markup=False, highlight=False
            )
    for row in rows:
        if row.remark:
            note(f"{row.task}, {NAMES[row.method]}: {row.remark}")


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when `auto` succeeded on every pair it was asked for (or was not asked)."""
    look_at_folder("--output", options.output)
    rows: list[Row] = []
    runs: list[Run] = []
    said = setting()
    said["limits"] = {"seconds a plan": options.time_limit} | said["limits"]
    with progress("timing the methods", options.count * len(options.tasks) * len(options.methods)) as bar:
        for task in options.tasks:
            for method in options.methods:
                own = []
                for seed in range(options.seed, options.seed + options.count):
                    own.append(run_one(task, seed, method, options.time_limit, options.output))
                    bar.at(len(runs) + len(own))
                runs += own
                rows.append(row_of(own))
    ok = all(row.successes == row.runs for row in rows if row.method == "auto")
    result = {
        "ok": ok,
        "time_limit_s": options.time_limit,
        "methods": METHODS_HERE,
        "setting": said,
        "rows": [asdict(row) | {"paper": PAPER.get((row.task, row.method))} for row in rows],
        "runs": [asdict(one) for one in runs],
    }
    (options.output / "table2.json").write_text(json.dumps(result, indent=1, default=float), encoding="utf-8")
    _show(rows, setting_text(said), options.output / "table2.txt")
    if options.json:
        print_json(result)
    return 0 if ok else 1
