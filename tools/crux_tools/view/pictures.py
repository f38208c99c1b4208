"""Pictures and films of the page, taken by Chromium without a window."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from crux_contracts.output_file import write_whole
from PIL import Image

from crux_tools.output import progress
from crux_tools.view.browser import Page, open_page
from crux_tools.view.film import mp4
from crux_tools.view.server import Source, Viewer, moment

SIZE_PX = (1500, 950)
FRAMES_A_S = 10
READY = "window.crux?.view.connected === true && !crux.page.asking && crux.page.wanted === null"
_SHARP = "crux.page.spaces.forEach((space) => space.draw(true))"
_PLOTTED = "crux.plots.every((plot) => plot.names.every((name) => plot.curves[name]))"


@contextmanager
def _page(sources: list[Source], at_s: float) -> Iterator[Page]:
    viewer = Viewer(sources, "127.0.0.1", 0)
    try:
        with open_page(viewer.url + moment(at_s), SIZE_PX) as page:
            page.wait_until(f"{READY} && {_PLOTTED}")
            yield page
    finally:
        viewer.close()


def write_screenshot(path: Path, sources: list[Source], at_s: float) -> None:
    """PNG of the page. Raises WorkFailed without Chromium."""
    with _page(sources, at_s) as page:
        page.value(_SHARP)
        write_whole(path, page.picture())


def write_video(path: Path, sources: list[Source], from_s: float, to_s: float, speed: float) -> int:
    """A film of the page as it plays, in the form that the file's name ends with; returns the number of frames."""
    times_s = np.arange(from_s, to_s, speed / FRAMES_A_S)
    pictures = []
    with _page(sources, from_s) as page, progress("filming", len(times_s)) as bar:
        for i, time_s in enumerate(times_s):
            page.value(f"crux.seek({time_s})")
            page.wait_until(READY)
            page.value(_SHARP)
            pictures.append(page.picture())
            bar.at(i)
    write_whole(path, mp4(pictures, SIZE_PX, FRAMES_A_S) if path.suffix == ".mp4" else _animated(pictures, path.suffix))
    return len(pictures)


def _animated(pictures: list[bytes], suffix: str) -> bytes:
    """In one of the forms that Pillow writes."""
    film = io.BytesIO()
    first, *more = (Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures)
    first.save(film, suffix[1:], save_all=True, append_images=more, duration=round(1000 / FRAMES_A_S), loop=0)
    return film.getvalue()
