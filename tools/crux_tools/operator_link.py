"""An operator's line to a runtime over LCM: upload a plan, send commands, read the acknowledgements."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from crux_contracts import channels
from crux_contracts.terminal import in_a_line
from crux_msgs import acknowledgement_t, command_t, plan_piece_t, plan_t, status_t

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.lcm_binding import lcm
from crux_tools.operator_key import OperatorKey, default_path

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
NO_NETWORK = "without a network, as root: ip link set lo up && ip route add 224.0.0.0/4 dev lo"
START_IT = "start crux-runtime there, or name its --lcm URL"
ANSWER_TIMEOUT_S = 0.5
VERDICT_TIMEOUT_S = 10.0  # the runtime decodes and validates the whole plan
TRIES = 4
LEASE_LEFT_S = 2.0  # with less the lease is renewed first
STATES = {value: name for name, value in (("idle", 0), ("ready", 1), ("climbing", 2), ("holding", 3), ("fault", 4))}


@dataclass
class OperatorLink:
    """One LCM connection. Request ids count from `first_request`, so a bench run sends the same bytes every time."""

    url: str = DEFAULT_URL
    first_request: int = 1
    connection: Any = None
    """what is used instead of lcm.LCM(url), with the same methods"""
    key: Path | None = None
    """the private key to sign with, where the runtime wants it; None: the one that `crux key new` makes"""
    _answers: list[acknowledgement_t] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._next_request = self.first_request
        try:
            self._lcm = lcm.LCM(self.url) if self.connection is None else self.connection
        except RuntimeError as error:
            raise UsageError(f"cannot open LCM at {self.url}: {error} ({NO_NETWORK})") from error
        self._subscriptions = [
            self._lcm.subscribe(channels.CRUX_ACKNOWLEDGEMENT, self._keep),
            self._lcm.subscribe(channels.CRUX_STATUS, self._keep_status),
        ]
        self.status: status_t | None = None
        """what the runtime said beside its acknowledgement, where the last command was STATUS; None: nothing"""
        self._told: status_t | None = None  # last by the runtime, whoever asked
        self._signer: OperatorKey | None = None
        self._counter = self._lease = 0
        self._lease_end_s = 0.0

    def __enter__(self) -> OperatorLink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A subscription keeps its handler, and so this link and LCM's sockets, for as long as it is kept itself.
        while self._subscriptions:
            self._lcm.unsubscribe(self._subscriptions.pop())

    def _keep(self, _channel: str, data: bytes) -> None:
        self._answers.append(acknowledgement_t.decode(data))

    def _keep_status(self, _channel: str, data: bytes) -> None:
        self.status = self._told = status_t.decode(data)

    def _await(self, wanted: Callable[[acknowledgement_t], bool], timeout_s: float) -> acknowledgement_t | None:
        end = time.monotonic() + timeout_s
        while True:
            for answer in self._answers:
                if wanted(answer):
                    self._answers.remove(answer)
                    return answer
            left_s = end - time.monotonic()
            if left_s <= 0:
                return None
            self._lcm.handle_timeout(max(1, int(left_s * 1000)))

    def _begin(self) -> None:
        """Hears what has come since: LCM keeps thirty messages, and drops the answer to come behind those of others."""
        while self._lcm.handle_timeout(0):
            pass
        self.status = None

    def _answer_to(self, request_id: int, timeout_s: float) -> acknowledgement_t | None:
        return self._await(lambda a: a.subject == acknowledgement_t.COMMAND and a.request_id == request_id, timeout_s)

    def command(
        self,
        command: int,
        plan_id: str = "",
        at_cycle: int = 0,
        value: float = 0.0,
        tries: int = TRIES,
        timeout_s: float = ANSWER_TIMEOUT_S,
        is_worth_it: Callable[[], bool] = lambda: True,
    ) -> acknowledgement_t | None:
        """Sends a command (command_t constant) until it is acknowledged; None when nobody answers.

        Every try is the same message with the same request id and waits `timeout_s`; `is_worth_it` comes first. What
        needs a signature is signed; raises UsageError where there is no key.
        """
        asks = command == command_t.STATUS
        if not asks and self._told is None and self.command(command_t.STATUS, tries=tries) is None:
            return None
        message = command_t()
        message.request_id = self._next_request
        message.command = command
        message.at_cycle = at_cycle
        message.plan_id = plan_id
        message.value = value
        self._next_request += 1
        answer = None
        for _ in range(tries):
            if not is_worth_it():
                break
            if not asks and command != command_t.HOLD and (refused := self._without_lease()) is not None:
                return refused
            self._begin()
            if asks or not self._signs():
                self._lcm.publish(channels.CRUX_COMMAND, message.encode())
            else:
                self._publish_signed(message.encode())
            answer = self._answer_to(message.request_id, timeout_s)
            if answer is not None and (asks or not self._is_stale(answer)):
                break
        return answer

    def take_lease(self) -> acknowledgement_t | None:
        """Asks to be the one who commands, or to stay it; None when nobody answers. Raises UsageError without a key."""
        if self._told is None and self.command(command_t.STATUS) is None:
            return None
        answer = None
        for _ in range(TRIES):
            self._begin()
            counter = self._publish_signed(b"")
            answer = self._answer_to(counter, ANSWER_TIMEOUT_S)
            if answer is not None and answer.verdict == acknowledgement_t.ACCEPTED and self.status is not None:
                self._lease = self.status.lease
                self._lease_end_s = time.monotonic() + self.status.lease_s
            if answer is not None and not self._is_stale(answer):
                break
        return answer

    def _without_lease(self) -> acknowledgement_t | None:
        """The runtime's refusal of the lease, where a command needs one and has none."""
        if not self._signs() or time.monotonic() < self._lease_end_s - LEASE_LEFT_S:
            return None
        answer = self.take_lease()
        return None if answer is None or answer.verdict == acknowledgement_t.ACCEPTED else answer

    def _signs(self) -> bool:
        """Whether the runtime wants it; one that has told nothing of itself is of an older crux."""
        return self._told is not None and not self._told.insecure

    def _is_stale(self, answer: acknowledgement_t) -> bool:
        """Refused because session, lease or counter have passed, which the runtime shows by telling the new ones."""
        refused = answer.verdict != acknowledgement_t.ACCEPTED
        stale = refused and self.status is not None and self.status.request_id == answer.request_id
        self._lease_end_s = 0.0 if stale else self._lease_end_s
        return stale

    def _publish_signed(self, data: bytes) -> int:
        """Signs and sends; returns the counter."""
        if self._signer is None:
            self._signer = OperatorKey(self.key or default_path())
        session, known = (0, 0) if self._told is None else (self._told.session, self._told.counter)
        self._counter = max(time.time_ns(), self._counter + 1, known + 1)
        self._lcm.publish(channels.CRUX_SIGNED, self._signer.sealed(session, self._counter, self._lease, data))
        return self._counter

    def send(self, command: int, plan_id: str = "", at_cycle: int = 0, value: float = 0.0) -> acknowledgement_t:
        """Like command(), but raises WorkFailed when nobody answers or the runtime refuses."""
        answer = self.command(command, plan_id, at_cycle, value)
        if answer is None:
            raise WorkFailed(f"no runtime answers on {self.url}; {START_IT}")
        if answer.verdict != acknowledgement_t.ACCEPTED:
            raise WorkFailed(f"the runtime refuses: {in_a_line(answer.reason)}")
        return answer

    def upload(self, plan: plan_t) -> acknowledgement_t:
        """Uploads a plan piece by piece.

        Raises UsageError with the runtime's reason when it refuses the plan, WorkFailed when it does not answer.
        """
        if self._told is None and self.command(command_t.STATUS) is None:
            raise WorkFailed(f"no runtime answers on {self.url}; {START_IT}")
        data = plan.encode()
        pieces = [data[i : i + plan_piece_t.MAX_BYTES] for i in range(0, len(data), plan_piece_t.MAX_BYTES)]
        digest = hashlib.sha256(data).hexdigest()
        transfer_id = int(digest[:15], 16)
        for index, piece in enumerate(pieces):
            message = plan_piece_t()
            message.transfer_id = transfer_id
            message.plan_id = plan.plan_id
            message.bytes_sha256 = digest
            message.total_bytes = len(data)
            message.n_pieces = len(pieces)
            message.piece = index
            message.n_bytes = len(piece)
            message.data = piece
            self._send_piece(message)
        verdict = self._await(
            lambda a: a.subject == acknowledgement_t.PLAN and a.request_id == transfer_id, VERDICT_TIMEOUT_S
        )
        if verdict is None:
            raise WorkFailed(f"the runtime took all {len(pieces)} pieces of the plan but gave no verdict")
        if verdict.verdict != acknowledgement_t.ACCEPTED:
            raise UsageError(f"the runtime refuses the plan: {in_a_line(verdict.reason)}")
        return verdict

    def _send_piece(self, message: plan_piece_t) -> None:
        for _ in range(TRIES):
            if (refused := self._without_lease()) is not None:
                raise WorkFailed(f"the runtime refuses: {in_a_line(refused.reason)}")
            self._begin()
            if self._signs():
                self._publish_signed(message.encode())
            else:
                self._lcm.publish(channels.CRUX_PLAN_PIECE, message.encode())
            answer = self._await(
                lambda a: (
                    a.request_id == message.transfer_id
                    and (
                        (a.subject == acknowledgement_t.PLAN_PIECE and a.piece == message.piece)
                        or (a.subject == acknowledgement_t.PLAN and a.verdict == acknowledgement_t.REFUSED)
                    )
                ),
                ANSWER_TIMEOUT_S,
            )
            if answer is None or self._is_stale(answer):
                continue
            if answer.verdict != acknowledgement_t.ACCEPTED:
                raise UsageError(f"the runtime refuses the plan: {in_a_line(answer.reason)}")
            return
        raise WorkFailed(f"no runtime on {self.url} acknowledges piece {message.piece} of the plan; {START_IT}")
