"""Logs of the made-up climb, written once a session."""

from __future__ import annotations

from pathlib import Path

import pytest
from crux_tools.report import pictures
from crux_tools.report.renderer import NoGraphicsError
from made_up_climb import Story, write_log


@pytest.fixture(scope="session")
def log_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole log."""
    path = tmp_path_factory.mktemp("logs") / "climb.mcap"
    write_log(path)
    return path


@pytest.fixture(scope="session")
def faulty_log_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log in real time with a fault in it."""
    path = tmp_path_factory.mktemp("logs") / "faulty.mcap"
    write_log(path, Story(faults=((200, 7, -1),), pace="clock", late_ns=30_000))
    return path


@pytest.fixture(scope="session")
def killed_log_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a killed runtime leaves behind: chunks, no summary, no end."""
    path = tmp_path_factory.mktemp("logs") / "killed.mcap"
    write_log(path, finish=False)
    return path


@pytest.fixture
def no_graphics(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that cannot render. Pages without pictures are also quicker to write."""

    def no_renderer(*_: object) -> None:
        raise NoGraphicsError("no EGL")

    monkeypatch.setattr(pictures, "Renderer", no_renderer)


@pytest.fixture
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures on pages have so few pixels that rendering them takes no time."""
    monkeypatch.setattr("crux_tools.report.sections.PICTURE_PX", (64, 46))


@pytest.fixture
def briefly_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that stops climbing is watched for two seconds, not for ten: a fifth of what that takes to compute."""
    monkeypatch.setattr("crux_simulation.sim.climb.WATCHED_S", 2.0)
