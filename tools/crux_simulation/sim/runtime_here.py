"""The runtime's own code in this process, on buses in memory: no sockets, no other process, and the same log."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

from crux_contracts import channels
from crux_msgs import command_t
from crux_tools.errors import UsageError
from crux_tools.operator_link import OperatorLink

from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.native import library
from crux_simulation.sim.runtime_process import log_reason

Wanted = Callable[[str, bytes], bool]


class RuntimeHere:
    """As RuntimeProcess; leaving the context ends it. It is an LCM for its operators, too."""

    def __init__(self, nodes: FirmwareNodes, arguments: list[str]) -> None:
        """`nodes` have buses in memory. Raises UsageError with the runtime's reason."""
        self._sim = library()
        words = (ctypes.c_char_p * len(arguments))(*(word.encode() for word in arguments))
        self._handle = ctypes.c_void_p(self._sim.crux_runtime_open(nodes.handle, len(arguments), words))
        if not self._handle:
            raise UsageError(f"crux-runtime: {self._sim.crux_runtime_error().decode(errors='replace')}")
        self._trouble = ""
        self.idle: Callable[[], None] | None = None
        """lets time pass while somebody waits for an answer"""
        nodes.before_sync = self._turn

    def __enter__(self) -> RuntimeHere:
        return self

    def __exit__(self, *_: object) -> None:
        self.wait()
        self._sim.crux_runtime_close(self._handle)

    def _turn(self) -> None:
        self._sim.crux_runtime_turn(self._handle)

    def is_alive(self) -> bool:
        """It lives as long as this process."""
        return True

    crashed = False

    def last_words(self) -> str:
        """Nothing: a runtime that crashes takes this process with it."""
        return ""

    def log_trouble(self) -> str:
        """Why the log is incomplete, after wait(); empty when nothing is known against it."""
        return log_reason(self._trouble) or self._trouble

    def await_answer(self, link: OperatorLink) -> None:
        """It is there at once."""
        link.command(command_t.STATUS)

    def wait(self) -> None:
        """Ends it, and its log."""
        self._trouble = self._sim.crux_runtime_finish(self._handle).decode(errors="replace")

    # ---- what an operator's link needs of an LcmSocket

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message to the runtime, which serves it at once."""
        self._sim.crux_runtime_tell(self._handle, channel.encode(), data, len(data))

    def receive(self, timeout_s: float, wanted: Wanted) -> tuple[str, bytes, None] | None:
        """The next answer that is wanted; where time passes by `idle` alone, after a turn a millisecond at most."""
        for _ in range(round(1000 * timeout_s) if self.idle else 0):
            if (heard := self._next(wanted)) is not None:
                return heard
            assert self.idle is not None
            self.idle()
        return self._next(wanted)

    def _next(self, wanted: Wanted) -> tuple[str, bytes, None] | None:
        size = ctypes.c_int32()
        while data := self._sim.crux_runtime_next(self._handle, ctypes.byref(size)):
            answer = ctypes.string_at(data, size.value)
            if wanted(channels.CRUX_ANSWER, answer):
                return channels.CRUX_ANSWER, answer, None
        return None
