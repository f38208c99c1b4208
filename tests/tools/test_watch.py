"""`crux watch`: what is heard over real LCM becomes a recording, row by row; nothing is sent."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from crux_simulation.sim.ports import run_ports
from crux_tools.cli import main
from crux_tools.report.pictures import place_measured
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry import read_log
from crux_tools.telemetry.description import robot_of
from crux_tools.view.browser import open_page
from crux_tools.view.live import Live
from crux_tools.view.recording import Recording
from crux_tools.view.server import Viewer
from crux_tools.view.story import story_of
from made_up_climb import made_up_plan


@pytest.fixture
def url() -> Iterator[str]:
    with run_ports() as ports:
        yield ports.lcm_url


def play(log_path: Path, url: str, from_s: str, to_s: str) -> None:
    words = ["--speed", "4", "--from", from_s, "--to", to_s]
    assert main(["log", "lcm", str(log_path), *words, "--lcm", url]) == 0


def heard(live: Live, least_s: float, most_s: float = float("inf")) -> Recording:
    """What is heard once its last moment lies in between."""
    end = time.monotonic() + 600
    while not least_s <= live.recording().log.time_s[-1] < most_s:
        assert time.monotonic() < end
        time.sleep(0.02)
    return live.recording()


def settled(live: Live) -> Recording:
    """What is heard once nothing that waits in a queue is left to be read."""
    end, recording = time.monotonic() + 600, live.recording()
    while True:
        time.sleep(0.2)
        before, recording = recording, live.recording()
        if recording is before:
            return recording
        assert time.monotonic() < end


@pytest.mark.alone
def test_rows_are_those_of_the_log(url: str, log_path: Path) -> None:
    log = read_log(log_path)
    live = Live(url, made_up_plan())
    play(log_path, url, "0.4", "2.2")
    live.wait_for_first()
    heard(live, 2.1)
    recording = settled(live)
    assert live.recording() is recording  # nothing new
    cycles = recording.log.state["cycle"]
    assert len(cycles) > 0.8 * 85  # 50 Hz; the kernel may drop some
    for name in ("supervisor_state", "plan_time_s", "body_position_w_m", "waiting_for"):
        np.testing.assert_array_equal(recording.log.state[name], log.state[name][cycles])
    np.testing.assert_array_equal(recording.log.limbs["force_w_n"], log.limbs["force_w_n"][cycles])
    assert [span[2] for span in story_of(recording, 0.0)["lanes"][0]["spans"]] == ["READY", "CLIMBING"]
    assert [event.text for event in recording.events if "→" in event.text] == ["READY → CLIMBING"]


def test_the_joints_put_the_grippers_where_the_runtime_says(url: str, log_path: Path) -> None:
    live = Live(url, made_up_plan())
    play(log_path, url, "0.4", "0.8")
    live.wait_for_first()
    log = heard(live, 0.7).log
    with robot_of("scaler", {}) as described:
        robot = build_model(described, log.plan)
    data = mujoco.MjData(robot.model)
    place_measured(robot, data, log, len(log.time_s) - 1)
    mujoco.mj_kinematics(robot.model, data)
    at = data.site_xpos[robot.gripper_sites]
    np.testing.assert_allclose(at, log.limbs["gripper_position_w_m"][-1], atol=1e-5)


@pytest.mark.alone
def test_a_plan_that_comes_is_the_wall_and_the_view_follows(url: str, log_path: Path) -> None:
    live = Live(url, None)
    play(log_path, url, "0", "0.6")
    live.wait_for_first()
    viewer = Viewer([live.recording], "127.0.0.1", 0)
    try:
        before = viewer.at(None)[0]["time_s"]
        play(log_path, url, "0.7", "1.2")
        heard(live, 1.1)
        assert viewer.at(None)[0]["time_s"] > before + 0.4
        assert viewer.answer("/story", {})["sides"][0]["what"] == "live"
        play(log_path, url, "0.4", "0.6")  # a runtime that began anew
        heard(live, 0.5, 0.7)
    finally:
        viewer.close()


def test_the_page_follows(url: str, log_path: Path) -> None:
    live = Live(url, made_up_plan())
    play(log_path, url, "0.4", "0.6")
    live.wait_for_first()
    viewer = Viewer([live.recording], "127.0.0.1", 0)
    try:
        with open_page(viewer.url, (900, 600)) as page:
            page.wait_until("window.crux?.view.connected === true && crux.view.shown > 0")
            play(log_path, url, "0.6", "1.2")
            heard(live, 1.1)
            page.wait_until("crux.view.time > 1.1")
            page.press("ArrowLeft")
            assert page.value("crux.byId('follow').checked") is False
            assert page.errors == []
    finally:
        viewer.close()
