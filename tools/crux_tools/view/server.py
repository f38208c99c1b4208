"""Serves the viewer: a page with the robot in 3-D, a time line and plots.

The page keeps the time and asks for what it draws; all who look at one server look at moments of their own.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from crux_tools.view.page_server import PageServer, Query, files_of
from crux_tools.view.recording import Recording
from crux_tools.view.scene import Scene
from crux_tools.view.signals import Signal, difference, reduced, signals_of, unit_of
from crux_tools.view.story import start_s, story_of

PAGE = Path(__file__).parent / "page"
MOST_POINTS = 4000
Source = Callable[[float, float], Recording]  # as it is now, as fine as it is to be had between two of its times
ALL = (-math.inf, math.inf)


def moment(at_s: float) -> str:
    """What is behind the page's address for a moment; nothing for NaN."""
    return "" if math.isnan(at_s) else f"/#t={at_s:g}"


def still(recording: Recording) -> Source:
    """The source of a recording that does not grow."""
    return lambda _from_s, _to_s: recording


class Side:
    """One recording: its 3-D view, its signals and how its times are shifted to those of the first."""

    def __init__(self, source: Source, shift_s: float) -> None:
        self.source, self.shift_s = source, shift_s
        recording = source(*ALL)
        self.scene = Scene(recording)
        self._known = (recording, signals_of(recording))

    def between(self, from_s: float, to_s: float) -> Recording:
        """As fine as it is to be had between two times of the page."""
        return self.source(from_s - self.shift_s, to_s - self.shift_s)

    def signals(self, from_s: float = -math.inf, to_s: float = math.inf) -> dict[str, Signal]:
        """Of the recording as it is now."""
        recording = self.between(from_s, to_s)
        if recording is not self._known[0]:
            self._known = (recording, signals_of(recording))
        return self._known[1]

    def at(self, time_s: float | None, span_s: float) -> dict[str, Any]:
        """What is to be drawn at a time of the page, which shows a span about it, or of the newest row."""
        recording = self.source(*ALL) if time_s is None else self.between(time_s - span_s / 2, time_s + span_s / 2)
        row = recording.row_at(math.inf if time_s is None else time_s - self.shift_s)
        told = {"time_s": float(recording.log.time_s[row]) + self.shift_s, **self.scene.caption(row, recording)}
        return told | self.scene.at(row, recording)

    def reach(self, time_s: float, span_s: float) -> dict[str, list[float]]:
        """Where every gripper can stand from where the body is at a time of the page."""
        recording = self.between(time_s - span_s / 2, time_s + span_s / 2)
        return self.scene.reach(recording.row_at(time_s - self.shift_s), recording)


class Viewer(PageServer):
    """A running viewer of recordings."""

    def __init__(self, sources: list[Source], host: str, port: int) -> None:
        self._working = threading.Lock()  # one request a thread
        begins = [start_s(source(*ALL)) for source in sources]
        super().__init__(files_of(PAGE), "/page.html", host, port)
        self.sides = [Side(source, begins[0] - begin) for source, begin in zip(sources, begins, strict=True)]
        self.start()

    def reach(self, time_s: float, span_s: float) -> list[dict[str, list[float]]]:
        """Of every side at a time of the page: see `Scene.reach`."""
        with self._working:
            return [side.reach(time_s, span_s) for side in self.sides]

    def at(self, time_s: float | None, span_s: float = math.inf) -> list[dict[str, Any]]:
        """What every side shows at a time of the page, which shows so much of it; None: each its newest row."""
        with self._working:
            return [side.at(time_s, span_s) for side in self.sides]

    def answer(self, path: str, query: Query) -> Any:
        """What a path of the page's is answered with. Raises KeyError for an unknown one, ValueError for a number."""
        if path == "/story":
            return self._story()
        if path == "/at":
            return self.at(float(query["time_s"]), float(query["span_s"])) if query else self.at(None)
        if path == "/reach":
            return self.reach(float(query["time_s"]), float(query["span_s"]))
        if path == "/signal":
            return self._signal(query["name"], float(query["from_s"]), float(query["to_s"]), int(query["points"]))
        if path == "/scene":
            return [side.scene.description for side in self.sides]
        return super().answer(path, query)

    def _story(self) -> dict[str, Any]:
        stories = [story_of(side.source(*ALL), side.shift_s) for side in self.sides]
        return {"sides": stories, "signals": {name: unit_of(name) for name in self.sides[0].signals()}}

    def _signal(self, name: str, from_s: float, to_s: float, points: int) -> list[dict[str, Any]]:
        """The course on each side, and the difference where there are two."""
        points = min(max(points, 2), MOST_POINTS)
        with self._working:
            sides = [(side, side.signals(from_s, to_s).get(name)) for side in self.sides]
        found = [
            {"shift_s": side.shift_s, **reduced(signal, from_s - side.shift_s, to_s - side.shift_s, points)}
            for side, signal in sides
            if signal is not None
        ]
        if len(found) == 2:
            (_, a), (other, b) = sides
            assert a is not None
            assert b is not None
            found.append({"shift_s": 0.0, **reduced(difference(a, b, other.shift_s), from_s, to_s, points)})
        return found
