"""`crux bench table2`: one pair of one method, and how runs are summed up."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from crux_planner.method_report import METHODS_HERE
from crux_simulation.benchmarks import table2
from crux_simulation.benchmarks.cold_process import measured
from crux_tools.cli import main


def run_of(seconds: float, *, ok: bool = True, remark: str = "") -> table2.Run:
    return table2.Run("climbing", 1, "auto", ok, seconds, 100.0, 12.0 if ok else None, None, remark, {})


@pytest.mark.sweep
def test_one_pair_is_timed_checked_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--count", "1", "--tasks", "climbing", "--methods", "auto", "--output", str(tmp_path), "--json"]
    assert main(["bench", "table2", *words]) == 0
    said = json.loads(capsys.readouterr().out)
    (row,) = said["rows"]
    assert (row["successes"], row["runs"], row["half_width_s"]) == (1, 1, None)
    assert 0.3 < row["mean_s"] < 60.0
    assert 50.0 < row["peak_MB"] < 2000.0
    assert json.loads((tmp_path / "table2.json").read_text())["ok"]
    table = (tmp_path / "table2.txt").read_text()
    assert "auto" in table
    assert "gap: to a bound proven for the reach it plans with" in table
    assert METHODS_HERE in table


def test_the_interval_is_students() -> None:
    """t(0.995, 2) = 9.925 for three runs; failures count for the success alone."""
    row = table2.row_of([run_of(1.0), run_of(2.0), run_of(3.0), run_of(9.0, ok=False, remark="why not")])
    assert row.mean_s == pytest.approx(2.0)
    assert row.half_width_s == pytest.approx(9.925 / 3**0.5, rel=1e-3)
    assert (row.successes, row.runs, row.remark) == (3, 4, "why not")
    assert table2.time_text(table2.row_of([run_of(5.0, ok=False)])) == "none"
    assert row.converged is None


def test_converged_counts_plans_before_which_the_blocks_agreed() -> None:
    each = [{"method_report": {"converged": said}} for said in (True, True, False)]
    row = table2.row_of([replace(run_of(1.0), method="two_block", details=details) for details in each])
    assert (row.successes, row.converged) == (3, 2)


def test_a_run_beyond_its_limit_is_ended() -> None:
    done = measured("timeit", "-n", "1", "import time; time.sleep(30)", limit_s=0.5)
    assert done.result == {"ok": False, "error": "ended after 0.5 s"}
    assert done.seconds < 5.0
