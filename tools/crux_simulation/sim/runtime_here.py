"""The runtime's own code in this process, on buses in memory: no sockets, no other process, and the same log."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from types import TracebackType

from crux_contracts import channels
from crux_msgs import command_t
from crux_tools.errors import UsageError
from crux_tools.operator_link import OperatorLink

from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.native import library
from crux_simulation.sim.runtime_process import log_reason

Handler = Callable[[str, bytes], None]


class RuntimeHere:
    """As RuntimeProcess; leaving the context ends it. It is an LCM for its operators, too."""

    def __init__(self, nodes: FirmwareNodes, arguments: list[str]) -> None:
        """`nodes` have buses in memory. Raises UsageError with the runtime's reason."""
        self._sim = library()
        words = (ctypes.c_char_p * len(arguments))(*(word.encode() for word in arguments))
        self._handle = ctypes.c_void_p(self._sim.crux_runtime_open(nodes.handle, len(arguments), words))
        if not self._handle:
            raise UsageError(f"crux-runtime: {self._sim.crux_runtime_error().decode(errors='replace')}")
        self._handlers: dict[str, Handler] = {}
        self._trouble = ""
        self.idle: Callable[[], None] | None = None
        """lets time pass while somebody waits for an answer"""
        nodes.before_sync = self._turn

    def __enter__(self) -> RuntimeHere:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
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
        """It is there at once; what a process is asked until it answers is asked here, too: requests are numbered."""
        link.command(command_t.STATUS)

    def wait(self) -> None:
        """Ends it, and its log."""
        self._trouble = self._sim.crux_runtime_finish(self._handle).decode(errors="replace")

    # ---- what an operator's link needs of LCM

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message to the runtime, which serves it at once."""
        self._sim.crux_runtime_tell(self._handle, channel.encode(), data, len(data))

    def subscribe(self, channel: str, handler: Handler) -> str:
        """From now on what the runtime says there goes to `handler`."""
        self._handlers[channel] = handler
        return channel

    def unsubscribe(self, subscription: str) -> None:
        """No more."""
        self._handlers.pop(subscription, None)

    def handle_timeout(self, timeout_ms: int) -> int:
        """Hands on one message; where time passes by `idle` alone, after so many turns of it at most."""
        for _ in range(timeout_ms if self.idle else 0):
            if self._hand_on():
                return 1
            assert self.idle is not None
            self.idle()
        return self._hand_on()

    def _hand_on(self) -> int:
        size, is_status = ctypes.c_int32(), ctypes.c_int32()
        data = self._sim.crux_runtime_next(self._handle, ctypes.byref(size), ctypes.byref(is_status))
        if not data:
            return 0
        channel = channels.CRUX_STATUS if is_status.value else channels.CRUX_ACKNOWLEDGEMENT
        if channel in self._handlers:
            self._handlers[channel](channel, ctypes.string_at(data, size.value))
        return 1
