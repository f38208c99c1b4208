"""Worker processes: what they answer, how they end, and that the planner has no other processes."""

from __future__ import annotations

import ast
import math
import multiprocessing
import operator
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import crux_planner
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import load_scenario
from crux_planner.errors import InfeasibleError
from crux_planner.pipeline import climb
from crux_planner.solvers import worker
from crux_planner.solvers.worker import Team, Worker, WorkerLostError
from walls import one_move, scenario

ROOT = Path(__file__).resolve().parents[3]
PLANNER = ROOT / "planner" / "crux_planner"
STARTING = {"multiprocessing", "subprocess", "concurrent.futures", "asyncio", "threading", "pty"}
WALK = ROOT / "msgs" / "scenarios" / "walk-flat.yaml"


def gone(process: int) -> bool:
    """Whether a process has ended, within a time that no machine needs."""
    for _ in range(600):
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        if state == "Z":
            return True
        time.sleep(0.1)
    return False


def test_a_team_answers_as_one_process_does() -> None:
    with Worker() as one, Worker() as other:
        team: Team[int] = Team([one, other], operator.methodcaller, "bit_length")
        assert team.answers([(2**i,) for i in range(8)]) == list(range(1, 9))
        assert one.process is not None


def test_what_a_function_says_comes_before_what_it_returns_and_errors_come_whole() -> None:
    with Worker() as other:
        other.begin(map_and_say, "worker")
        assert [other.receive(), other.waiting, other.receive(), other.waiting] == ["w", 1, "worker", 0]
        other.begin(fail)
        with pytest.raises(InfeasibleError, match="no way") as caught:
            other.receive()
        assert (caught.value.constraint, caught.value.proven) == ("reach", True)


def map_and_say(text: str) -> str:
    worker.say(text[0])
    return text


def fail() -> None:
    raise InfeasibleError("reach", "no way", proven=True)


def test_a_worker_that_dies_is_told_once_and_its_work_is_done_here() -> None:
    said: list[str] = []
    with Worker(log=said.append) as other:
        team: Team[float] = Team([other], operator.methodcaller, "__abs__")
        assert team.answers([(-1.0,), (-2.0,)]) == [1.0, 2.0]
        assert other.process is not None
        os.kill(other.process.pid, signal.SIGKILL)
        assert team.answers([(-1.0,), (-2.0,), (-3.0,)]) == [1.0, 2.0, 3.0]
        assert team.answers([(-1.0,), (-2.0,)]) == [1.0, 2.0]
        with pytest.raises(WorkerLostError, match="ended"):
            other.receive()
    assert len(said) == 1
    assert "signal 9" in said[0]


@pytest.mark.parametrize("busy", [False, True])
def test_a_worker_ends_with_its_parent(busy: bool, tmp_path: Path) -> None:
    """Killed, so that the parent can do nothing about it; its main module has no guard and must not run again."""
    script = tmp_path / "parent.py"
    script.write_text(
        "import time\nfrom pathlib import Path\nfrom crux_planner.solvers.worker import Worker\n"
        "with Path('runs').open('a') as runs:\n    runs.write('run\\n')\n"
        "other = Worker('json')\nother.start()\nother.begin(len, 'four')\nassert other.receive() == 4\n"
        f"if {busy}:\n    other.begin(time.sleep, 3600)\n"
        "print(other.process.pid, flush=True)\ntime.sleep(3600)\n"
    )
    with subprocess.Popen(
        [sys.executable, str(script)], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        assert parent.stderr is not None
        child = int(parent.stdout.readline())
        os.kill(child, signal.SIGINT)  # as Ctrl-C sends it to both
        assert Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        parent.kill()
        assert gone(child)
        assert parent.stderr.read() == ""
    assert (tmp_path / "runs").read_text() == "run\n"


def test_ctrl_c_leaves_no_process_behind(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "crux_tools.cli", "plan", str(WALK), "-o", str(tmp_path / "plan.mcap")]
    with subprocess.Popen(words, start_new_session=True, stderr=subprocess.PIPE, text=True) as crux:
        children: list[int] = []
        while not children and crux.poll() is None:
            children = [int(pid) for pid in Path(f"/proc/{crux.pid}/task/{crux.pid}/children").read_text().split()]
        assert children
        os.killpg(crux.pid, signal.SIGINT)
        assert crux.stderr is not None
        assert crux.stderr.read().splitlines() in (["crux plan: interrupted"], [])
        assert crux.wait() != 0
    assert all(gone(child) for child in children)


def test_a_plan_goes_on_without_its_bound(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    monkeypatch.setattr(climb, "plan_by_map", lambda *_, **__: None)  # by which the bound has no process of its own
    said: list[str] = []
    result = crux_planner.plan(scenario(one_move()), robot, log=said.append)
    assert result.ok
    assert result.gap is None
    assert said == ["a worker process ended with status 1; planning goes on without it"]


LONG = [("auto", "walk"), ("multi_block", "climb"), ("multi_block", "walk")]


@pytest.mark.parametrize(
    ("method", "what"), [("auto", "climb"), *(pytest.param(*each, marks=pytest.mark.sweep) for each in LONG)]
)
def test_nothing_forks(method: str, what: str, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process made by fork keeps locks of threads that it does not have: only a fresh interpreter will do."""

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a process is made by fork")

    monkeypatch.setattr(os, "fork", refuse)
    monkeypatch.setattr(os, "forkpty", refuse)
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)
    wall = load_scenario(WALK) if what == "walk" else scenario(one_move())
    result = crux_planner.plan(wall, robot, method=method, time_limit_s=600.0)
    assert result.ok
    assert result.gap is not None
    assert math.isfinite(result.gap)


def test_there_is_one_way_to_start_a_process() -> None:
    starting = set()
    for path in PLANNER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [name.name for name in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "", *(f"{node.module}.{name.name}" for name in node.names)]
            forks = isinstance(node, ast.Attribute) and node.attr in ("fork", "forkpty", "posix_spawn", "system")
            if forks or any(name == each or name.startswith(each + ".") for name in names for each in STARTING):
                starting.add(path.relative_to(PLANNER).as_posix())
    assert starting == {"solvers/worker.py"}
