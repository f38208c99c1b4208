"""Serves the 3-D view of a log to browsers, with a time slider and play and pause."""

from __future__ import annotations

import contextlib
import io
import threading
import time
from typing import Any

import numpy as np
import viser

from crux_tools.replay.scene import ReplayScene, caption
from crux_tools.telemetry import Telemetry

FRAME_S = 1 / 25
TIME_STEP_S = 0.01
SPEEDS = ("0.25", "1", "4", "16")


def _quiet() -> contextlib.redirect_stdout[io.StringIO]:
    """viser greets and takes leave on standard output, which belongs to the summary."""
    return contextlib.redirect_stdout(io.StringIO())


class Viewer:
    """A running server; `close` ends it. A port that is taken gives way to the next free one: see `url`."""

    def __init__(self, log: Telemetry, host: str, port: int) -> None:
        self._log = log
        with _quiet():
            self._server = viser.ViserServer(host=host, port=port, label="crux", verbose=False)
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self.scene = ReplayScene(self._server, log)
        self._begin_s, self._end_s = float(log.time_s[0]), float(log.time_s[-1])
        gui = self._server.gui
        end_s = max(self._end_s, self._begin_s + TIME_STEP_S)
        self._time: Any = gui.add_slider("time [s]", self._begin_s, end_s, TIME_STEP_S, self._begin_s)
        self._play = gui.add_checkbox("play", initial_value=False)
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        plan = gui.add_checkbox("plan", initial_value=True)
        self._text = gui.add_markdown("")
        gui.add_markdown("Blue: measured forces on the robot. Orange: plan.")
        self._stop = threading.Event()
        self._drawing = threading.Lock()  # the player and the slider's own thread both draw
        self._time.on_update(lambda _: self._show())
        plan.on_update(lambda _: self.scene.show_plan(plan.value))
        self._show()
        self._player = threading.Thread(target=self._run, name="replay", daemon=True)
        self._player.start()

    @property
    def url(self) -> str:
        """Where a browser finds the view."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    def row_at(self, time_s: float) -> int:
        """The row of the log that is shown at a time of the slider."""
        return int(np.clip(np.searchsorted(self._log.time_s, time_s, side="right") - 1, 0, len(self._log.time_s) - 1))

    def show_at(self, time_s: float) -> None:
        """Moves the slider, and with it the view, to a time of the log."""
        self._time.value = time_s

    def _show(self) -> None:
        row = self.row_at(self._time.value)
        with self._drawing, self._server.atomic():
            self.scene.show(row)
        self._text.content = caption(self._log, row)

    def _run(self) -> None:
        last = time.monotonic()
        while not self._stop.wait(FRAME_S):
            now = time.monotonic()
            if self._play.value:
                at = self._time.value + (now - last) * float(self._speed.value)
                if at >= self._end_s:
                    at = self._begin_s
                self.show_at(at)
            last = now

    def wait(self) -> None:
        """Serves until interrupted."""
        self._player.join()

    def close(self) -> None:
        """Ends playing and closes the port."""
        self._stop.set()
        self._player.join()
        with _quiet():
            self._server.stop()
