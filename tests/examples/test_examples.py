"""Every example does what it says; results against something that it does not use."""

from __future__ import annotations

import json
import math
import re
import runpy
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import crux_nodes
import matplotlib.pyplot as plt
import numpy as np
import pytest
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_simulation.sim.ports import BUS_GROUP, run_ports
from crux_tools.cli import main as crux
from crux_tools.paths import ROOT, SCENARIOS, built
from hand_plan import standing_plan
from made_up_climb import Story, write_log

EXAMPLES = ROOT / "examples"
LONGEST = 60  # lines
JOINT = 3
DAMPING_NMS_RAD = 4.0  # of the made-up joint: a torque turns it at torque / damping


def example(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


def test_all_of_them_are_here_and_short() -> None:
    explained = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert f"test_{path.stem}" in globals()
        assert f"[{path.name}]({path.name})" in explained
        assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST
    for path in EXAMPLES.glob("*.ipynb"):
        assert f"test_{path.stem}" in globals()
        assert f"[{path.name}]({path.name})" in explained


def test_plan_a_wall(capsys: pytest.CaptureFixture[str]) -> None:
    example("plan_a_wall")["main"]([str(SCENARIOS / "climb-one-step.yaml"), "--factors", "1", "0.05"])
    heading, planned, refused = capsys.readouterr().out.splitlines()
    assert heading.split()[0] == "friction"
    factor, steps, cost = planned.split()[:3]
    assert (float(factor), int(steps) > 0, float(cost) > 0) == (1.0, True, True)
    assert "no plan" in refused
    assert "equilibrium" in refused


def test_own_checker(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, plan, checker = tmp_path / "plan.mcap", standing_plan(), example("own_checker")
    write_plan(path, plan)
    assert checker["main"]([str(path)])
    assert "unbalanced force 0.0" in capsys.readouterr().out
    limb = plan.knots[0].limbs[0]
    limb.finger_force_w_n = [force + 100.0 * (axis == 2) for axis, force in enumerate(limb.finger_force_w_n)]
    write_plan(path, plan)
    assert not checker["main"]([str(path)])
    assert checker["unbalanced_N"](plan, load_robot("scaler").total_mass_kg) == pytest.approx(100.0, abs=0.5)
    assert checker["grip_margin_N"](plan, limb) < -20.0


def test_watch_a_climb(tmp_path: Path) -> None:
    log = tmp_path / "climb.mcap"
    write_log(log, Story(faults=((200, 7, -1),)))
    with run_ports() as ports:
        words = [sys.executable, "-u", str(EXAMPLES / "watch_a_climb.py"), "--lcm", ports.lcm_url]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as watching:
            try:
                for _ in range(20):  # who listens late hears the next one
                    assert crux(["log", "lcm", str(log), "--speed", "20", "--lcm", ports.lcm_url]) == 0
                    if watching.poll() is not None:
                        break
            finally:
                watching.kill()
            assert watching.stdout is not None
            lines = watching.stdout.read().splitlines()
    assert "plan    2.8 of 2.8 s  limit surface used: LF" in lines[-1]
    assert "fault 7: body_error" in lines


def test_look_at_a_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "climb.mcap"
    write_log(log)
    monkeypatch.setenv("CRUX_LOG", str(log))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    seen = example("look_at_a_log")
    assert seen["off_mm"].max() == pytest.approx(1e3 * seen["summary"].tracking.body_max_m, rel=1e-3)
    assert "body off its reference" in capsys.readouterr().out


def test_plan_from_a_notebook(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Cell by cell, as Jupyter runs it: each prints what is stored below it, and draws where a picture is stored."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, Any] = {}
    plt.close("all")  # what other tests have drawn
    notebook = json.loads((EXAMPLES / "plan_from_a_notebook.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == [*range(1, len(cells) + 1)]
    for cell in cells:
        exec("".join(cell["source"]), names)
        stored = [output["text"] for output in cell["outputs"] if output["output_type"] == "stream"]
        assert capsys.readouterr().out == "".join(line for text in stored for line in text)
        pictures = [output for output in cell["outputs"] if "image/png" in output.get("data", {})]
        assert len(plt.get_fignums()) == len(pictures)
        plt.close("all")
    assert not np.isnan(names["arrays"].wrench).any()


@contextmanager
def nodes_with_a_joint_that_turns(port: int) -> Iterator[None]:
    """The firmware's nodes in a thread, one limb on UDP, its joints turning slowly with their torque."""
    robot = load_robot("scaler")
    buses = [f"udp:{BUS_GROUP}:{port}", "memory:", "memory:", "memory:"]
    joints, grippers = crux_nodes.joint_parameters(robot), crux_nodes.gripper_parameters(robot)
    angle = np.array([(joint.position_min_rad + joint.position_max_rad) / 2 for joint in joints])
    zero, opening = np.zeros(crux_nodes.JOINTS), np.full(4, 0.03)
    ended = threading.Event()
    with crux_nodes.Nodes(built("firmware/libcrux_nodes.so"), buses, joints, grippers) as nodes:
        for limb in (1, 2, 3):
            nodes.connect(limb, False)

        def run() -> None:
            while not ended.is_set():
                nodes.wait_sync(0.1)
                torque, _ = nodes.control(robot.dt_s, angle, zero, opening, np.zeros(4), np.zeros(4))
                angle[:] += torque / DAMPING_NMS_RAD * robot.dt_s
                nodes.publish(angle, zero, torque, opening, np.zeros(4), np.zeros(4), np.zeros((4, 6)))

        thread = threading.Thread(target=run)
        thread.start()
        yield
        ended.set()
        thread.join()


def test_move_a_joint(capsys: pytest.CaptureFixture[str]) -> None:
    main = example("move_a_joint")["main"]
    with run_ports() as ports, nodes_with_a_joint_that_turns(ports.base):
        words = f"--interface udp_multicast --channel {BUS_GROUP} --port {ports.base} --joint {JOINT} --degrees 5"
        main(words.split())
    start, way, end = (float(number) for number in re.findall(r"(\S+) rad", capsys.readouterr().out))
    limits = load_robot("scaler").limbs[0].joints[JOINT - 1]
    assert start == pytest.approx((limits.lower + limits.upper) / 2, abs=1e-3)
    assert way == pytest.approx(math.radians(5), rel=0.15)
    assert end == pytest.approx(start, abs=0.01)
