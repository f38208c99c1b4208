"""Serves a page to browsers: its files, what it asks for as JSON, and what it sends where a server takes that."""

from __future__ import annotations

import contextlib
import json
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from crux_tools.output import note
from crux_tools.page_address import addresses
from crux_tools.view.guard import Guard, headers

KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
PORTS = 100  # that are tried, from the wished one on
MOST_BYTES = 8 << 20  # of what a page sends
Query = dict[str, str]


class RefusedError(Exception):
    """What a page asks for cannot be; str() says why, to be shown as it stands."""


def files_of(folder: Path) -> dict[str, Path]:
    """The files of a page by their paths on the server."""
    return {f"/{path.relative_to(folder)}": path for path in folder.rglob("*") if path.suffix in KINDS}


class PageServer:
    """A running server; `close` ends it. A port that is taken gives way to the next free one: see `urls`.

    Beyond this machine it answers only who has the token in them.
    """

    def __init__(self, files: Mapping[str, Path], page: str, host: str, port: int) -> None:
        """Listens, and answers from `start` on. `page`: the one of `files` that "/" is. Raises OSError."""
        self.files = {**files, "/": files[page]}
        self.headers = {"Cache-Control": "no-store", **headers(files[page].read_text(encoding="utf-8"))}
        self._server = _listening(host, port, self)
        self.port = self._server.server_port
        self.guard = Guard(host, str(self._server.server_address[0]))
        self.urls = [f"http://{address}:{self.port}{self.guard.prefix}" for address in addresses(host)]
        self._thread = threading.Thread(target=self._server.serve_forever, name="page server", daemon=True)

    def start(self) -> None:
        """Begins to answer."""
        self._thread.start()

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the page."""
        return self.urls[0]

    def answer(self, path: str, _query: Query) -> Any:
        """What a path of the page's is answered with. Raises KeyError for an unknown one, ValueError for a number."""
        raise KeyError(path)

    def take(self, path: str, _content: Any) -> Any:
        """What the page gets for JSON that it sends to a path. Raises KeyError for an unknown one, ValueError for
        content that is none, RefusedError.
        """
        raise KeyError(path)

    def wait(self) -> None:
        """Serves until interrupted."""
        while self._thread.is_alive():
            self._thread.join(1.0)

    def close(self) -> None:
        """Closes the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def serve(server: PageServer, what: str, behind: str = "") -> None:
    """Prints the page's addresses, with what is `behind` them, and serves it until Ctrl-C."""
    try:
        here, *others = (url + behind for url in server.urls)
        note(f"{what}: {here} (Ctrl-C ends it)")
        for url in others:
            note(f"      {url} from other machines")
        server.wait()
    except KeyboardInterrupt:  # how it is meant to end
        pass
    finally:
        server.close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # head and body are sent apart
    server_version, sys_version = "crux", ""
    server: _Server

    def do_GET(self) -> None:
        """A file of the page, or JSON."""
        path, query = self._asked(self.server.page.guard.refusal(self.headers))
        if path is None:
            return
        files = self.server.page.files
        if path in files:
            self._send(200, KINDS[files[path].suffix], files[path].read_bytes())
        else:
            self._answer(path, lambda: self.server.page.answer(path, query))

    def do_POST(self) -> None:
        """JSON for JSON; from the page itself alone."""
        guard = self.server.page.guard
        path, _ = self._asked(guard.refusal(self.headers) or guard.refusal_of_sent(self.headers))
        if path is None:
            self.close_connection = True  # what was sent is not read
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MOST_BYTES:
            self.close_connection = True
            self._send(413, "text/plain", f"expected at most {MOST_BYTES} bytes".encode())
            return
        try:
            sent = json.loads(self.rfile.read(int(length)))
        except (RecursionError, ValueError):
            self._send(400, "text/plain", b"expected JSON")
            return
        self._answer(path, lambda: self.server.page.take(path, sent))

    def _asked(self, refusal: str) -> tuple[str | None, Query]:
        """The path behind the token and its query; None where the request has been answered already."""
        try:
            parts = urlsplit(self.path)
        except ValueError:
            parts = urlsplit("//")
        guard = self.server.page.guard
        path = None if parts.netloc else guard.inner(parts.path)
        if refusal := refusal or ("" if path is not None else "open the link that crux printed"):
            self._send(403, "text/plain", refusal.encode())
        elif path == "":
            self._send(308, "text/plain", b"", {"Location": f"{guard.prefix}/"})
        else:
            return path, {key: values[-1] for key, values in parse_qs(parts.query).items()}
        return None, {}

    def _answer(self, path: str, found: Callable[[], Any]) -> None:
        try:
            content = found()
        except RefusedError as error:
            self._send(409, "text/plain", str(error).encode())
            return
        except (KeyError, ValueError) as error:
            self._send(404, "text/plain", f"no {path}: {error}".encode())
            return
        self._send(200, "application/json", json.dumps(content, separators=(",", ":")).encode())

    def _send(self, status: int, kind: str, body: bytes, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        for name, value in {**self.server.page.headers, **(more or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # a page that was closed
            self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Nothing: standard error is for the person at the terminal."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], page: PageServer) -> None:
        self.address_family = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)[0][0]
        super().__init__(address, _Handler)
        self.page = page

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that was closed while it asked is none."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def _listening(host: str, port: int, page: PageServer) -> _Server:
    """On the first free port from the wished one on; 0 is any. Raises OSError."""
    for tried in range(port, port + (PORTS if port else 1)):
        try:
            return _Server((host, tried), page)
        except OSError:
            if tried in {0, port + PORTS - 1}:
                raise
    raise AssertionError
