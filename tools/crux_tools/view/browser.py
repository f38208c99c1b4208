"""A browser without a window: Chromium, spoken to by its DevTools protocol, for pictures of the page and for tests."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from crux_tools.errors import WorkFailed

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_ARGUMENTS = (
    "--headless=new",
    "--remote-debugging-port=0",
    "--no-first-run",
    "--disable-extensions",
    "--use-angle=swiftshader",  # OpenGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # the page itself is put together by the processor: by such an OpenGL it takes seconds
    "--hide-scrollbars",
)
START_S, ANSWER_S = 60.0, 240.0  # software draws slowly, on a busy machine most of all


class Page:
    """One page in it. `errors`: what was told to the console as an error, and exceptions, as they came."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._number = 0
        self._contexts: list[int] = []
        self.errors: list[str] = []

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the DevTools protocol and its answer. Raises WorkFailed where the browser refuses it."""
        self._number += 1
        self._connection.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            try:
                message = json.loads(self._connection.recv(timeout=ANSWER_S))
            except (TimeoutError, ConnectionClosed) as error:
                raise WorkFailed(f"the browser does not answer {method} ({type(error).__name__})") from error
            if message.get("id") == self._number:
                if "error" in message:
                    raise WorkFailed(f"the browser refuses {method}: {message['error'].get('message')}")
                return dict(message["result"])
            self._listen(message)

    def _listen(self, message: dict[str, Any]) -> None:
        told = message.get("params", {})
        if message.get("method") == "Runtime.executionContextCreated":
            self._contexts.append(told["context"]["id"])
        elif message.get("method") == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.errors.append(str(details.get("exception", {}).get("description", details.get("text"))))
        elif message.get("method") == "Runtime.consoleAPICalled" and told["type"] == "error":
            self.errors.append(" ".join(str(each.get("value", each.get("description"))) for each in told["args"]))
        elif message.get("method") == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.errors.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")

    def value(self, expression: str) -> Any:
        """What an expression in the page gives; a promise is awaited. Raises WorkFailed for an exception."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise WorkFailed(f"{expression}: {answer['exceptionDetails'].get('exception', {}).get('description')}")
        return answer["result"].get("value")

    def wait_until(self, expression: str, timeout_s: float = ANSWER_S) -> None:
        """Until an expression is true. Raises WorkFailed where it does not become so."""
        end = time.monotonic() + timeout_s
        while not self.value(expression):
            if time.monotonic() > end:
                raise WorkFailed(f"the page has not come so far in {timeout_s:g} s: {expression}")
            time.sleep(0.05)

    def everywhere(self, expression: str) -> None:
        """Evaluates an expression in every frame."""
        for context in self._contexts:
            with contextlib.suppress(WorkFailed):  # one that is gone
                self.call("Runtime.evaluate", expression=expression, contextId=context)

    def press(self, key: str, shift: bool = False) -> None:
        """A key by its name in KeyboardEvent.key."""
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0, **text)
            text = {}

    def picture(self) -> bytes:
        """PNG of what is to be seen."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])


@contextmanager
def open_page(url: str, size_px: tuple[int, int]) -> Iterator[Page]:
    """A page of `size_px`. Raises WorkFailed where there is no Chromium, or where it does not start."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        raise WorkFailed("no picture: it needs Chromium (on Debian: apt-get install chromium)")
    sandbox = ["--no-sandbox"] if os.getuid() == 0 else []  # Chromium has none for root
    with tempfile.TemporaryDirectory(prefix="crux-browser-", ignore_cleanup_errors=True) as folder:
        size = f"--window-size={size_px[0]},{size_px[1]}"
        words = [program, *_ARGUMENTS, *sandbox, size, f"--user-data-dir={folder}", "about:blank"]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
            try:
                assert process.stderr is not None
                with connect(_target(process.stderr.readline), max_size=None, compression=None) as connection:
                    page = Page(connection)
                    for domain in ("Runtime", "Log", "Page"):
                        page.call(f"{domain}.enable")
                    width, height = size_px
                    page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1,
                              mobile=False)  # fmt: skip
                    page.call("Emulation.setFocusEmulationEnabled", enabled=True)
                    page.call("Page.navigate", url=url)
                    yield page
            finally:
                process.kill()


def _target(line_of: Callable[[], str]) -> str:
    """The address of the first page, from what Chromium says when it starts."""
    end, said = time.monotonic() + START_S, ""
    while time.monotonic() < end and (line := line_of()):
        said = line
        if found := re.search(r"DevTools listening on ws://([^/]+)/", line):
            while time.monotonic() < end:
                with urllib.request.urlopen(f"http://{found[1]}/json/list", timeout=START_S) as answer:
                    pages = [each for each in json.load(answer) if each["type"] == "page"]
                if pages:
                    return str(pages[0]["webSocketDebuggerUrl"])
                time.sleep(0.05)
    raise WorkFailed(f"Chromium does not start: {said.strip()}")
