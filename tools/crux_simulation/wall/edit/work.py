"""The process that looks at walls for the page: what is asked for next cancels what it is doing."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from multiprocessing.connection import Connection, Pipe
from typing import Any

from crux_contracts.scenario import Scenario

from crux_simulation.wall.edit.content import Content, missing
from crux_simulation.wall.edit.look import Told

BUSY, IDLE = "busy", "idle"
CHILD = """
import sys
from multiprocessing.connection import Connection
link = Connection(int(sys.argv[1]))
sys.path[:] = link.recv()
from crux_simulation.wall.edit.look import serve
serve(link)
"""
LOST = "the process that plans has ended by itself; perhaps this machine has too little memory. Any change plans again."


class Work:
    """`told` is what is known of the newest wall."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._link: Connection | None = None
        self._reached_for = ""
        self._stamp, self._reach_stamp, self._version = 0, 0, -1
        self._reach: Told | None = None
        self._motion: Told | None = None
        self._told: Told = {"state": IDLE, "plan": None, "doing": None}
        self._begin()

    def _begin(self) -> None:
        """A process that has loaded what it needs by the time it is asked: a fresh interpreter, without this one's main
        module.
        """
        link, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", CHILD, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        self._link = link
        self._send(sys.path)
        threading.Thread(target=self._listen, args=(link,), daemon=True).start()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        if self._link is not None:
            self._link.close()
        self._link = None

    def _anew(self) -> None:
        """A process that does nothing yet; there is none where the one before has ended by itself."""
        if self._told["state"] == BUSY:
            self._end()
        if self._link is None:
            self._begin()

    def _send(self, message: Any) -> None:
        with contextlib.suppress(OSError):  # it has ended, which `_listen` finds out
            if self._link is not None:
                self._link.send(message)

    @property
    def pid(self) -> int:
        """Of the process."""
        return int(self._process.pid)

    def look(self, version: int, content: Content, scenario: Scenario) -> None:
        """Begins with a wall, and leaves the one before."""
        with self._lock:
            self._anew()
            key = _reach_key(content, scenario)
            looks = key != self._reached_for or self._reach is None
            if looks:
                self._reached_for, self._reach, self._reach_stamp = key, None, self._stamp + 1
            self._told |= {"state": BUSY, "plan": None, "doing": None}
            self._motion, self._version = None, version
            self._note()
            self._send((scenario, looks, not missing(content)))

    def leave(self, version: int) -> None:
        """There is no wall to look at, as it is."""
        with self._lock:
            self._anew()
            self._told |= {"state": IDLE, "plan": None, "doing": None}
            self._motion, self._version = None, version
            self._note()

    def told(self, since: int, wait_s: float) -> dict[str, Any] | None:
        """What is known, where that is newer than a stamp, or becomes so within a while; else None."""
        with self._changed:
            self._changed.wait_for(lambda: self._stamp > since, wait_s)
            if self._stamp <= since:
                return None
            told = {"stamp": self._stamp, "version": self._version, **self._told}
            told["moves"] = self._motion is not None
            return told | ({"reach": self._reach} if self._reach_stamp > since else {})

    def motion(self, version: int) -> Told | None:
        """Of the plan, where it is that of this version."""
        with self._lock:
            return self._motion if version == self._version else None

    def close(self) -> None:
        """Ends the process."""
        with self._lock:
            self._end()

    def _note(self) -> None:
        self._stamp += 1
        self._changed.notify_all()

    def _listen(self, link: Connection) -> None:
        while True:
            try:
                told = link.recv()
            except (EOFError, OSError):
                told = {"kind": "failed", "text": LOST}
            with self._lock:
                if link is not self._link:
                    return
                if told.get("text") == LOST:
                    self._end()
                self._take(told)
                self._note()

    def _take(self, told: Told) -> None:
        if told["kind"] == "reach":
            self._reach, self._reach_stamp = told, self._stamp + 1
        elif told["kind"] == "motion":
            self._motion = told
        elif told["kind"] == "done":
            self._told |= {"state": IDLE, "doing": None}
        elif told["kind"] == "doing":
            self._told["doing"] = told
        else:
            self._told["plan"] = told
        if told["kind"] == "failed":
            self._told |= {"state": IDLE, "doing": None}


def _reach_key(content: Content, scenario: Scenario) -> str:
    """What reach and stances depend on."""
    kept = {key: value for key, value in content.items() if key not in {"start", "goal", "horizon", "planner"}}
    start, goal = scenario.start.body, scenario.goal.body
    return json.dumps([kept, start.position_m[2], start.rpy_deg, goal.rpy_deg], sort_keys=True)
