"""Serves the viewer: a page with the robot in 3-D, a time line and plots.

The page keeps the time and asks for what it draws; all who look at one server look at moments of their own.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from crux_tools.page_address import addresses
from crux_tools.view.guard import Guard, headers
from crux_tools.view.recording import Recording
from crux_tools.view.scene import Scene
from crux_tools.view.signals import Signal, difference, reduced, signals_of, unit_of
from crux_tools.view.story import start_s, story_of

PAGE = Path(__file__).parent / "page"
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
FILES = {f"/{path.relative_to(PAGE)}": path for path in PAGE.rglob("*") if path.suffix in KINDS}
FILES["/"] = FILES["/page.html"]
HEADERS = {"Cache-Control": "no-store", **headers(FILES["/"].read_text(encoding="utf-8"))}
MOST_POINTS = 4000
PORTS = 100  # that are tried, from the wished one on
Query = dict[str, str]
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


class Viewer:
    """A running server; `close` ends it. A port that is taken gives way to the next free one: see `urls`.

    Beyond this machine it answers only who has the token in them.
    """

    def __init__(self, sources: list[Source], host: str, port: int) -> None:
        self._working = threading.Lock()  # one request a thread
        begins = [start_s(source(*ALL)) for source in sources]
        self._server = _listening(host, port, self)
        self.port = self._server.server_port
        self.guard = Guard(host, str(self._server.server_address[0]))
        self.urls = [f"http://{address}:{self.port}{self.guard.prefix}" for address in addresses(host)]
        self.sides = [Side(source, begins[0] - begin) for source, begin in zip(sources, begins, strict=True)]
        self._thread = threading.Thread(target=self._server.serve_forever, name="viewer", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the page."""
        return self.urls[0]

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
        raise KeyError(path)

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

    def wait(self) -> None:
        """Serves until interrupted."""
        while self._thread.is_alive():
            self._thread.join(1.0)

    def close(self) -> None:
        """Closes the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # head and body are sent apart
    server_version, sys_version = "crux", ""
    server: _Server

    def do_GET(self) -> None:
        """A file of the page, or JSON."""
        guard = self.server.viewer.guard
        try:
            parts = urlsplit(self.path)
        except ValueError:
            parts = urlsplit("//")
        path = None if parts.netloc else guard.inner(parts.path)
        if refusal := guard.refusal(self.headers) or ("" if path is not None else "open the link that crux printed"):
            self._send(403, "text/plain", refusal.encode())
        elif path == "":
            self._send(308, "text/plain", b"", {"Location": f"{guard.prefix}/"})
        else:
            assert path is not None
            self._answer(path, parts.query)

    def _answer(self, path: str, query: str) -> None:
        if path in FILES:
            file = FILES[path]
            self._send(200, KINDS[file.suffix], file.read_bytes())
            return
        try:
            found = self.server.viewer.answer(path, {key: values[-1] for key, values in parse_qs(query).items()})
        except (KeyError, ValueError) as error:
            self._send(404, "text/plain", f"no {path}: {error}".encode())
            return
        self._send(200, "application/json", json.dumps(found, separators=(",", ":")).encode())

    def _send(self, status: int, kind: str, body: bytes, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        for name, value in {**HEADERS, **(more or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # a page that was closed
            self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Nothing: standard error is for the person at the terminal."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], viewer: Viewer) -> None:
        self.address_family = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)[0][0]
        super().__init__(address, _Handler)
        self.viewer = viewer

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that was closed while it asked is none."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def _listening(host: str, port: int, viewer: Viewer) -> _Server:
    """On the first free port from the wished one on; 0 is any. Raises OSError."""
    for tried in range(port, port + (PORTS if port else 1)):
        try:
            return _Server((host, tried), viewer)
        except OSError:
            if tried in {0, port + PORTS - 1}:
                raise
    raise AssertionError
