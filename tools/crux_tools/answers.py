"""A runtime's answers to what this operator has sent: those that are signed, by a runtime he knows."""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from crux_contracts import channels
from crux_contracts.lcm_bytes import decoded
from crux_msgs import answer_t

from crux_tools.known_runtimes import KnownRuntime

FINGERPRINT, KEY, DIGEST, SIGNATURE = 8, 32, 32, 64
SENDERS, EACH, LONGEST = 1024, 256, 16384  # that wait for their turn, messages of each, bytes of one
WAITING = 4096  # beyond so many: one of each sender
BATCH = 512
KEPT = 256  # questions, and answers that nobody has wanted yet


@dataclass
class Answers:
    """Takes nothing but answers to what was asked, and looks at them a sender in turn: a flood delays itself alone."""

    link: Any
    """an LcmSocket, or what stands for one"""
    known: KnownRuntime | None
    """None: the runtime is in this process"""
    refused: bytes = b""
    """the key of a runtime that has answered and is not believed"""
    seen: set[bytes] = field(default_factory=set)
    """keys of those that are"""
    _asked: deque[bytes] = field(default_factory=lambda: deque(maxlen=KEPT), init=False)
    _waiting: dict[Any, deque[bytes]] = field(default_factory=dict, init=False)
    _n_waiting: int = field(default=0, init=False)
    _kept: deque[answer_t] = field(default_factory=lambda: deque(maxlen=KEPT), init=False)

    def ask(self, channel: str, data: bytes) -> None:
        """Sends a message, an answer to which may be awaited."""
        self._asked.append(hashlib.sha256(data).digest())
        self.link.publish(channel, data)

    def forget(self) -> None:
        """Nothing is awaited any more."""
        self._asked.clear()
        self._waiting.clear()
        self._n_waiting = 0
        self._kept.clear()

    def next(self, wanted: Callable[[answer_t], bool], timeout_s: float) -> answer_t | None:
        """The next one that is wanted; None when none has come in time."""
        end_s = time.monotonic() + timeout_s
        while True:
            for answer in self._kept:
                if wanted(answer):
                    self._kept.remove(answer)
                    return answer
            left_s = end_s - time.monotonic()
            if left_s <= 0:
                return None
            self._hear(0.0 if self._waiting else left_s)
            self._look()

    def _is_asked_for(self, channel: str, data: bytes) -> bool:
        request = data[FINGERPRINT + KEY : FINGERPRINT + KEY + DIGEST]
        return channel == channels.CRUX_ANSWER and len(data) <= LONGEST and request in self._asked

    def _hear(self, timeout_s: float) -> None:
        for _ in range(BATCH):
            heard = self.link.receive(timeout_s, self._is_asked_for)
            if heard is None:
                return
            timeout_s = 0.0
            _, data, sender = heard
            waiting = self._waiting.get(sender)
            if waiting is None and len(self._waiting) < SENDERS:
                self._waiting[sender] = deque([data])
            elif waiting is not None and len(waiting) < EACH and self._n_waiting < WAITING:
                waiting.append(data)
            else:
                continue
            self._n_waiting += 1

    def _look(self) -> None:
        """At one."""
        if not self._waiting:
            return
        sender = next(iter(self._waiting))
        waiting = self._waiting.pop(sender)
        data = waiting.popleft()
        self._n_waiting -= 1
        if waiting:
            self._waiting[sender] = waiting  # behind the others
        key = data[FINGERPRINT : FINGERPRINT + KEY]
        try:
            answer = decoded(answer_t, data)
        except ValueError:
            return
        if self.known is not None:
            if not _is_signed(data, key):
                return
            if not self.known.believes(key):
                self.refused = key
                return
            self.seen.add(key)
        self._kept.append(answer)


def _is_signed(data: bytes, key: bytes) -> bool:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(key).verify(data[-SIGNATURE:], data[:-SIGNATURE])
    except (InvalidSignature, ValueError):
        return False
    return True
