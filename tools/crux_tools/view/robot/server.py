"""Serves the page of `crux robot show`, and takes its picture."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from crux_contracts.output_file import write_whole

from crux_tools.view.browser import open_page
from crux_tools.view.page_server import PageServer, Query, files_of
from crux_tools.view.pictures import SIZE_PX
from crux_tools.view.robot.figure import Figure
from crux_tools.view.server import PAGE as VIEWER

PAGE = Path(__file__).parent / "page"
READY = "window.crux?.ready === true && crux.idle()"


class RobotPage(PageServer):
    """A running page of one robot, which begins on a wall of `slope_deg`."""

    def __init__(self, figure: Figure, slope_deg: float, host: str, port: int) -> None:
        """Raises OSError where nothing can be listened on."""
        files = {**files_of(VIEWER), **{f"/robot{path}": each for path, each in files_of(PAGE).items()}}
        super().__init__(files, "/robot/show.html", host, port)
        self._figure, self._slope_deg, self._working = figure, slope_deg, threading.Lock()  # one request a thread
        self.start()

    def answer(self, path: str, query: Query) -> Any:
        if path == "/robot":
            return {**self._figure.told(), "slopeDeg": self._slope_deg}
        if path == "/reach":
            with self._working:
                return self._figure.reach(int(query["limb"]))
        return super().answer(path, query)

    def take(self, path: str, content: Any) -> Any:
        if path != "/posture":
            return super().take(path, content)
        try:
            lifted = None if content["lifted"] is None else int(content["lifted"])
            return self._figure.at(content["q"], float(content["openingM"]), float(content["slopeDeg"]), lifted)
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"not understood: {error}") from error


def write_picture(path: Path, figure: Figure, slope_deg: float) -> None:
    """PNG of the page as it begins. Raises WorkFailed without Chromium."""
    server = RobotPage(figure, slope_deg, "127.0.0.1", 0)
    try:
        with open_page(server.url, SIZE_PX) as page:
            page.wait_until(READY)
            page.value("crux.scene.draw(true)")
            write_whole(path, page.picture())
    finally:
        server.close()
