"""A browser without a window: Chromium, spoken to by its DevTools protocol, for pictures of the page and for tests."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from crux_tools.errors import WorkFailed

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_ARGUMENTS = (
    "--headless=new",
    "--remote-debugging-pipe",  # no port: what can reach one commands the browser
    "--no-first-run",
    "--disable-extensions",
    "--use-angle=swiftshader",  # OpenGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # the page itself is put together by the processor: by such an OpenGL it takes seconds
    "--hide-scrollbars",
)
ANSWER_S = 240.0  # software draws slowly, on a busy machine most of all
# Chromium reads commands from descriptor 3 and writes answers to 4.
_LAUNCHER = "import os, sys; [os.dup2(int(sys.argv[i]), 2 + i) for i in (1, 2)]; os.execv(sys.argv[3], sys.argv[3:])"


class _Pipe:
    """Messages of the DevTools protocol to and from a browser: JSON, each ended by a zero byte."""

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers, self._bytes = commands, answers, b""

    def send(self, message: dict[str, Any]) -> None:
        left = json.dumps(message).encode() + b"\0"
        while left:
            left = left[os.write(self._commands, left) :]

    def receive(self) -> dict[str, Any]:
        """The next message. Raises TimeoutError after ANSWER_S, ConnectionError where the browser has ended."""
        end, parts = time.monotonic() + ANSWER_S, [self._bytes]
        while b"\0" not in parts[-1]:
            if not select.select([self._answers], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError
            if not (part := os.read(self._answers, 1 << 20)):
                raise ConnectionError
            parts.append(part)
        message, self._bytes = b"".join(parts).split(b"\0", 1)
        return dict(json.loads(message))


class Page:
    """One page in it. `errors`: what was told to the console as an error, and exceptions, as they came."""

    def __init__(self, pipe: _Pipe) -> None:
        self._pipe = pipe
        self._number = 0
        self._session: dict[str, Any] = {}
        self.errors: list[str] = []

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the DevTools protocol and its answer. Raises WorkFailed where the browser refuses it."""
        self._number += 1
        try:
            self._pipe.send({"id": self._number, "method": method, "params": parameters, **self._session})
            while (message := self._pipe.receive()).get("id") != self._number:
                self._listen(message)
        except OSError as error:  # the time is over, or the browser has ended
            raise WorkFailed(f"the browser does not answer {method} ({type(error).__name__})") from error
        if "error" in message:
            raise WorkFailed(f"the browser refuses {method}: {message['error'].get('message')}")
        return dict(message["result"])

    def attach(self) -> None:
        """To the page that the browser opened."""
        while not (pages := [each for each in self.call("Target.getTargets")["targetInfos"] if each["type"] == "page"]):
            time.sleep(0.05)
        answer = self.call("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)
        self._session = {"sessionId": answer["sessionId"]}

    def _listen(self, message: dict[str, Any]) -> None:
        told = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
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
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="crux-browser-", ignore_cleanup_errors=True))
        width, height = size_px
        size = f"--window-size={width},{height}"
        words = [program, *_ARGUMENTS, *sandbox, size, f"--user-data-dir={folder}", "about:blank"]
        page = Page(stack.enter_context(_browser(words)))
        page.attach()
        for domain in ("Runtime", "Log", "Page"):
            page.call(f"{domain}.enable")
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        page.call("Emulation.setFocusEmulationEnabled", enabled=True)
        page.call("Page.navigate", url=url)
        yield page


@contextmanager
def _browser(words: list[str]) -> Iterator[_Pipe]:
    """A browser that runs while the context lasts."""
    ends = []
    for end in (*os.pipe(), *os.pipe()):
        ends.append(fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10))  # clear of 3 and 4
        os.close(end)
    its_commands, commands, answers, its_answers = ends
    launcher = [sys.executable, "-IS", "-c", _LAUNCHER, str(its_commands), str(its_answers), *words]
    try:
        with subprocess.Popen(
            launcher, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, pass_fds=(its_commands, its_answers)
        ) as process:
            os.close(its_commands)
            os.close(its_answers)
            try:
                yield _Pipe(commands, answers)
            finally:
                process.kill()
    finally:
        os.close(commands)
        os.close(answers)
