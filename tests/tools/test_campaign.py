"""`crux campaign` against kill -9 of whoever takes part, other workers, wrong specs, and closed forms."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.scenario import parse_scenario
from crux_simulation.benchmarks.random_walls import random_wall
from crux_simulation.campaign.engine import run_jobs
from crux_simulation.campaign.job import ClimbJob, Outcome
from crux_simulation.campaign.spec import DRAWN, OF_FILE, SETTINGS, TOP, read_spec
from crux_simulation.campaign.store import Store
from crux_simulation.campaign.walls import Wall
from crux_simulation.sim.judge import Verdict, judge
from crux_tools.cli import main
from crux_tools.paths import ROOT
from crux_tools.report.campaign import campaign_rows, comparison_section, success
from crux_tools.report.results import read_rows
from crux_tools.report.statistics import Rate, difference, paired_difference
from distributed import Client, LocalCluster
from pyarrow import parquet
from short_climb import scenario_text
from tiny_campaign import TinyJob

HERE = Path(__file__).resolve().parent
SCRIPTS = Path(sys.executable).parent
LONGEST_S = 600.0
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
    impatient = {"DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "10ms"}  # as on a busy machine
    return started(HERE / "tiny_campaign.py", folder, str(count), *address, **impatient)


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


@pytest.mark.sweep
def test_a_worker_joins_by_address_in_mid_run_and_where_it_differs_is_said(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "crux_commit.py").write_text('COMMIT = "another"')
    with ExitStack() as stack:
        client = stack.enter_context(campaign(folder, 3))
        wait_for(lambda: ran(folder, "0") != [])
        dask, *words = shlex.split((folder / "join").read_text())
        stack.enter_context(started(SCRIPTS / dask, *words, PYTHONPATH=f"{tmp_path / 'other'}:{HERE}"))
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


@pytest.mark.sweep
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
    assert f"--dask {address}: is not encrypted: anyone who reaches it can run programs" in said
    assert "distributed" not in said
    assert parquet.read_table(folder / "out" / "results.parquet")["key"].to_pylist() == ["tiny-0"]


class Broken(TinyJob):
    """Ends with an error unless it may go on."""

    def run(self) -> Outcome:
        if not (self.folder / "go" / self.name).exists():
            with (self.folder / "ran" / self.name).open("a") as file:
                file.write("0\n")
            raise ValueError("of its\nown")
        return super().run()


def test_a_job_that_ends_with_an_error_has_a_row_that_says_so_and_is_tried_again(folder: Path) -> None:
    let(folder, "1")
    here = {"processes": False, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(n_workers=1, **here) as local, Client(local) as client:
        run_jobs([Broken("0", folder), TinyJob("1", folder)], Store(folder / "out"), client, "")
        error, good = read_rows(folder / "out")
        assert (error["verdict"], error["reason"]) == ("error", "ValueError: of its own")
        assert len(ran(folder, "0")) == 2
        assert success([error, good]) == Rate(1, 1)
        let(folder, "0")
        run_jobs([Broken("0", folder), TinyJob("1", folder)], Store(folder / "out"), client, "")
    assert [row["verdict"] for row in read_rows(folder / "out")] == ["failed", "climbed"]
    assert [len(ran(folder, name)) for name in "01"] == [3, 1]


def row(key: str, verdict: str, wall_hash: str = "a", walls: str = "wall") -> dict[str, object]:
    labels = {"walls": walls, "wall_seed": 1, "world": "nominal", "seed": 1, "method": "auto", "wall_hash": wall_hash}
    return {"key": key, **labels, "verdict": verdict, "reason": "", "check": {"ok": verdict != "infeasible"}}


def campaign_of(folder: Path, *rows: dict[str, object]) -> Path:
    store = Store(folder)
    for one in rows:
        store.put(Outcome(one))
    return folder


def test_intervals_are_those_of_their_sources() -> None:
    wilson, z = Rate(8, 10).interval, 1.959964
    for bound in (wilson.low, wilson.high):  # where |8/10 - p| is z standard deviations of p's own binomial
        assert abs(0.8 - bound) == pytest.approx(z * np.sqrt(bound * (1 - bound) / 10), rel=1e-6)
    newcombe = difference(Rate(48, 80), Rate(56, 70))  # Newcombe (1998), table II, row (a)
    assert [newcombe.low, newcombe.high] == pytest.approx([0.0524, 0.3339], abs=5e-5)


@pytest.mark.parametrize(("p_lost", "p_won"), [(0.1, 0.1), (0.05, 0.2), (0.3, 0.1)])
def test_the_interval_of_pairs_holds_the_truth_as_often_as_it_says(p_lost: float, p_won: float) -> None:
    drawn = np.random.default_rng(3).multinomial(60, [p_lost, p_won, 1 - p_lost - p_won], 4000)
    bounds = [paired_difference(int(lost), int(won), 60) for lost, won, _ in drawn]
    assert 0.935 <= np.mean([each.low <= p_won - p_lost <= each.high for each in bounds]) <= 0.99


def test_two_campaigns_are_compared_job_by_job_where_both_have_the_same(tmp_path: Path) -> None:
    then = campaign_of(
        tmp_path / "then", *(row(key, "climbed") for key in "abc"), row("d", "failed"), row("e", "failed")
    )
    now = [row("a", "climbed"), row("b", "failed"), row("c", "climbed", wall_hash="other"), row("d", "climbed")]
    here = campaign_of(tmp_path / "now", *now, row("e", "error"), row("f", "climbed", walls="ladder"))
    section = comparison_section(campaign_rows(here), campaign_rows(then), then)
    rows = dict(section.rows)
    assert rows["jobs that are in both"] == "3"  # c is of another wall now, e has no result
    assert rows["succeeded there alone"] == "1: b"
    assert rows["succeeded here alone"] == "1: d"
    assert section.verdict.startswith("Difference: 0.0 points (")
    assert [line[0] for line in section.table] == ["", "all", "walls"]  # no ladder there to compare with
    assert section.table[1][2].startswith("3 of 5: 60.0 %")
    assert section.table[1][3].startswith("4 of 5: 80.0 %")
    page = tmp_path / "page.html"
    assert main(["report", str(here), "--against", str(then), "-o", str(page)]) == 0
    assert "Against" in page.read_text()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("walls: [{draw: wal, count: 3}]", 'walls[0].draw: "wal": expected wall, ladder, field, planes or walk'),
        ("walls: [{draw: wall, count: 3, slop_deg: 45}]", "walls[0].slop_deg: unknown key; did you mean slope_deg?"),
        ("walls: [{draw: wall, count: 0}]", "walls[0].count: 0: expected a whole number in 1..1000000"),
        ("walls: [{draw: wall, count: 1, slope_deg: 200}]", "slope_deg: 200: expected a number in 0..180 deg"),
        ("walls: [{draw: ladder, count: 1, rungs: 4, obstacles: 3}]", "obstacles: 3: expected a whole number in 0..2"),
        (
            "walls: [{draw: ladder, count: 1, rungs: many, obstacles: 3}]",
            'rungs: "many": expected a whole number in 4..',
        ),
        ("walls: [{scenario: none.yaml}]", "none.yaml: no such file"),
        ("walls: []", "walls: a list of 0: expected one entry or more"),
        ("walls: [{draw: wall, count: 1}]\nmethods: [fast]", 'methods[0]: "fast": expected auto, two_block'),
        ("walls: [{draw: wall, count: 1}]\nseed: [1]", "seed: unknown key; did you mean seeds?"),
        ("walls: [{draw: wall, count: 1}]\nseeds: [-1]", "seeds[0]: -1: expected a whole number in 0.."),
    ],
)
def test_a_wrong_spec_is_refused_with_place_value_and_what_would_be_right(
    line: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(f"version: 1\n{line}\n")
    assert main(["campaign", str(spec), "--out", str(tmp_path / "out")]) == 2
    (message,) = capsys.readouterr().err.splitlines()
    assert message.startswith(f"crux campaign: {spec}:")
    assert said in message
    assert not (tmp_path / "out").exists()


def test_the_example_has_every_key_and_is_read() -> None:
    path = ROOT / "examples" / "campaign.yaml"
    assert read_spec(path).jobs
    named = set(re.findall(r"([a-z_]+):", path.read_text(encoding="utf-8")))
    assert {*TOP, *OF_FILE, *DRAWN}.union(*SETTINGS.values()) <= named
    assert {*SETTINGS} == set(re.findall(r"draw: ([a-z]+)", path.read_text(encoding="utf-8")))


def test_a_spec_is_walls_by_worlds_by_methods_by_seeds_each_once() -> None:
    jobs = read_spec(ROOT / "examples" / "four-hold-walls.yaml").jobs
    assert [(job.wall.seed, job.seed) for job in jobs] == [(seed, seed) for seed in range(1, 301)]
    assert jobs[6].wall.scenario() == random_wall(7)


@pytest.mark.parametrize("obstacles", [0, 3, 10])
def test_obstacles_of_a_ladder_stand_in_gaps_above_the_start_and_touch_no_hold(tmp_path: Path, obstacles: int) -> None:
    spec = tmp_path / "spec.yaml"
    walls = f"walls: [{{draw: ladder, count: 3, obstacles: {obstacles}}}]"
    spec.write_text(f"version: 1\n{walls}\nclimb: false\n")
    for job in read_spec(spec).jobs:
        wall = parse_scenario(job.wall.scenario())
        assert len(wall.obstacles) == obstacles
        for part in wall.obstacles:
            (x, y), long = part.position_m, part.size_m[0]
            column = sorted(hold.position_m[0] for hold in wall.holds if hold.position_m[1] * y > 0.0)
            nearest = np.sort(np.abs(np.array(column) - x))[:2]
            assert nearest[0] == pytest.approx(nearest[1], abs=2e-4)  # rounded
            assert x > column[2]
            assert nearest[0] - long / 2 > 0.06 / 2**0.5 + 0.005  # half a hold, however it is turned


def test_keys_are_of_what_a_job_depends_on(tmp_path: Path) -> None:
    spec = tmp_path / "spec.yaml"
    walls = "walls: [{draw: wall, count: 2, name: a}, {draw: wall, count: 2, first_seed: 2, name: b}]"
    spec.write_text(f"version: 1\n{walls}\nseeds: [5, 6]\nmethods: [auto, two_block]\n")
    jobs = read_spec(spec).jobs
    assert len({job.key for job in jobs}) == len(jobs) == 3 * 2 * 2  # the wall of seed 2 is drawn twice, run once
    job = ClimbJob("any", Wall("wall", 2, (("slope_deg", 45.0),)), 5)
    assert job.key == replace(job, walls="other").key
    others = [
        replace(job, wall=Wall("wall", 2, (("slope_deg", 50.0),))), replace(job, wall=Wall(text="a")),
        replace(job, seed=6), replace(job, method="auto"), replace(job, time_limit_s=9.0), replace(job, climbs=False),
    ]  # fmt: skip
    assert len({job.key, *(other.key for other in others)}) == 7


def test_a_campaign_of_one_wall_planned_checked_climbed_and_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, wall = tmp_path / "spec.yaml", tmp_path / "wall.yaml"
    spec.write_text(f"version: 1\nwalls: [{{scenario: {wall}}}]\nmethods: [auto]\n")
    wall.write_text(scenario_text())
    assert main(["campaign", str(spec), "--out", str(tmp_path / "out"), "--workers", "1", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdicts"] == {"climbed": 1}
    assert said["scheduler"] == json.loads((tmp_path / "out" / "campaign.json").read_text())["scheduler"]
    (result,) = parquet.read_table(said["table"]).to_pylist()
    assert (result["wall"], result["world"], result["method"]) == ("climb-one-step", "nominal", "auto")
    assert result["climb.reached_goal"]
    assert 0.0 < result["climb.goal_error.m"] < 0.01
    assert not (tmp_path / "out" / "failures").exists()


def test_of_a_failed_climb_everything_is_kept_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fallen(*given: Any) -> Verdict:
        return replace(judge(*given), fell=True, fall_reason="made to")

    monkeypatch.setattr("crux_simulation.sim.climb.judge", fallen)
    outcome = ClimbJob("wall", Wall(text=scenario_text()), 2, method="auto").run()
    Store(tmp_path).put(outcome)
    kept = tmp_path / "failures" / outcome.row["key"]
    assert outcome.row["verdict"] == "failed"
    assert sorted(file.name for file in kept.iterdir()) == ["log.mcap", "plan.mcap", "rerun.sh", "scenario.yaml"]
    assert (kept / "scenario.yaml").read_text() == scenario_text()
    commands = [line.split() for line in (kept / "rerun.sh").read_text().splitlines() if line.startswith("crux")]
    assert [words[1] for words in commands] == ["plan", "check", "climb"]
    monkeypatch.chdir(kept)
    assert main(commands[1][1:]) == 0
    page = tmp_path / "page.html"
    assert main(["report", str(tmp_path), "-o", str(page)]) == 0
    shown = page.read_text()
    assert "0 of 1: 0.0 % (0.0 to 79.3 %)" in shown
    assert shown.count('src="data:image/jpeg') == 1
    assert "climb-one-step, nominal" in shown
