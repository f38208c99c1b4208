"""An operator's line to a runtime over LCM: upload a plan, send commands, read the answers."""

from __future__ import annotations

import hashlib
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts import channels
from crux_contracts.terminal import in_a_line
from crux_msgs import acknowledgement_t, command_t, plan_piece_t, plan_t, status_t

from crux_tools.answers import Answers
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.known_runtimes import KnownRuntime
from crux_tools.lcm_socket import LcmSocket
from crux_tools.operator_key import OperatorKey, default_path

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
START_IT = "start crux-runtime there, or name its --lcm URL"
ANSWER_TIMEOUT_S = 0.5
HOLD_AGAIN_S = 0.01  # until it is answered: in a flood some packets are lost
HOLDS_TO_THE_UNKNOWN = 3
FIRST_CONTACT_S = 0.3  # in which others may say that they are the runtime
VERDICT_TIMEOUT_S = 10.0  # the runtime decodes and validates the whole plan
TRIES = 4
LEASE_LEFT_S = 2.0  # with less the lease is renewed first
STATES = dict(enumerate(name.lower() for name in channels.SUPERVISOR_STATES))


@dataclass
class OperatorLink:
    """One LCM connection. Request ids count from `first_request`, so a bench run sends the same commands every time;
    those of questions are random, so that nobody else can have asked the same before and kept the answer."""

    url: str = DEFAULT_URL
    first_request: int = 1
    connection: Any = None
    """a runtime in this process, with the methods of LcmSocket"""
    key: Path | None = None
    """the private key to sign with, where the runtime wants it; None: the one that `crux key new` makes"""

    def __post_init__(self) -> None:
        self._next_request = self.first_request
        self._lcm = LcmSocket(self.url) if self.connection is None else self.connection
        self._known = KnownRuntime(self.url) if self.connection is None else None
        self._answers = Answers(self._lcm, self._known)
        self.status: status_t | None = None
        """what the runtime said beside its acknowledgement, where the last command was STATUS; None: nothing"""
        self._told: status_t | None = None  # last by the runtime
        self._signer: OperatorKey | None = None
        self._lease_end_s = 0.0

    def __enter__(self) -> OperatorLink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the sockets back."""
        if self.connection is None:
            self._lcm.close()

    def _await(self, wanted: Callable[[acknowledgement_t], bool], timeout_s: float) -> acknowledgement_t | None:
        answer = self._answers.next(lambda each: wanted(each.acknowledgement), timeout_s)
        if answer is None:
            return None
        if answer.status:
            self.status = self._told = answer.status[0]
        return answer.acknowledgement

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
        needs a signature is signed; raises UsageError where there is no key, and where only a runtime answers that has
        another key than the one this operator knows.
        """
        message = command_t()
        message.command = command
        message.at_cycle = at_cycle
        message.plan_id = plan_id
        message.value = value
        if command == command_t.STATUS:
            message.request_id = secrets.randbits(62)
            send = self._ask
        else:
            if command != command_t.HOLD and not self._knows(tries):
                return None
            message.request_id = self._next_request
            self._next_request += 1
            send = self._hold if command == command_t.HOLD and at_cycle == 0 else self._say
        if send == self._hold and self.connection is None:
            tries, timeout_s = round(tries * timeout_s / HOLD_AGAIN_S), HOLD_AGAIN_S
        self._answers.forget()
        answer = None
        for number in range(tries):
            if not is_worth_it() or (number >= TRIES and self._answers.refused and send != self._hold):
                break
            if send == self._say and (refused := self._without_lease()) is not None:
                return refused
            self.status = None
            send(message.encode())
            answer = self._answer_to(message.request_id, timeout_s)
            if answer is not None and not self._is_stale(answer):
                break
        if command == command_t.STATUS and answer is not None:
            self._meet()
        if answer is None:
            self._look_at_the_others()
        if send == self._hold and answer is not None:
            self._make_sure(message.encode(), answer)
        return answer

    def _knows(self, tries: int = TRIES) -> bool:
        """Whether the runtime has told what it is, and whether commands have to be signed."""
        return self._told is not None or self.command(command_t.STATUS, tries=tries) is not None

    def _ask(self, data: bytes) -> None:
        self._answers.ask(channels.CRUX_COMMAND, data)

    def _say(self, data: bytes) -> None:
        if self._signs():
            self._ask_signed(data)
        else:
            self._ask(data)

    def _hold(self, data: bytes) -> None:
        """Needs nothing that the runtime has to tell first; who has no key may be lucky."""
        try:
            signer = None if self._told is not None and self._told.insecure else self._signing()
        except UsageError:
            if self.key is not None:
                raise
            signer = None
        if signer is None:
            self._ask(data)
        else:
            self._answers.ask(channels.CRUX_SIGNED, signer.sealed(0, 0, 0, data))

    def _make_sure(self, hold: bytes, answer: acknowledgement_t) -> None:
        """That HOLD has come to the robot's runtime, where anybody may have answered, and that it could be signed."""
        for _ in range(0 if self._is_certain() else HOLDS_TO_THE_UNKNOWN):
            time.sleep(HOLD_AGAIN_S)
            self._hold(hold)
        if answer.verdict != acknowledgement_t.ACCEPTED and self._signer is None and self._knows() and self._signs():
            self._signing()

    def _meet(self) -> None:
        """The first contact: the runtime that has answered is the one from now on, if no other says that it is."""
        if self._known is None or self._told is None or self._is_certain():
            return
        self._answers.next(lambda _: False, FIRST_CONTACT_S)
        keys = sorted(key.hex() for key in self._answers.seen)
        if len(keys) > 1:
            raise UsageError(
                f"{len(keys)} runtimes answer at {self.url} ({', '.join(keys[:2])}); say which is the robot's by a "
                f"line in {self._known.path}: {self._known.address} and its key, which it prints when it starts"
            )
        self._known.pin(bytes.fromhex(keys[0]), for_good=not self._told.insecure)

    def _is_certain(self) -> bool:
        """Whether what has answered is a runtime that was known before."""
        return self._known is None or any(map(self._known.is_certain, self._answers.seen))

    def _look_at_the_others(self) -> None:
        if self._known is not None and self._answers.refused:
            raise UsageError(self._known.changed(self._answers.refused))

    def take_lease(self) -> acknowledgement_t | None:
        """Asks to be the one who commands, or to stay it; None when nobody answers. Raises UsageError without a key."""
        if not self._knows():
            return None
        answer = None
        for _ in range(TRIES):
            self.status = None
            answer = self._answer_to(self._ask_signed(b""), ANSWER_TIMEOUT_S)
            if answer is not None and answer.verdict == acknowledgement_t.ACCEPTED and self._told is not None:
                self._lease_end_s = time.monotonic() + self._told.lease_s
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
        """Whether the runtime wants it."""
        return self._told is not None and not self._told.insecure

    def _is_stale(self, answer: acknowledgement_t) -> bool:
        """Refused because session, lease or counter have passed, which the runtime shows by telling the new ones."""
        stale = answer.verdict != acknowledgement_t.ACCEPTED and self.status is not None
        self._lease_end_s = 0.0 if stale else self._lease_end_s
        return stale

    def _signing(self) -> OperatorKey:
        if self._signer is None:
            self._signer = OperatorKey(self.key or default_path())
        return self._signer

    def _ask_signed(self, data: bytes) -> int:
        """Signs and sends; returns the counter."""
        signer = self._signing()
        counter, told = signer.next_counter(), self._told
        session, lease = (0, 0) if told is None else (told.session, told.lease)
        self._answers.ask(channels.CRUX_SIGNED, signer.sealed(session, counter, lease, data))
        return counter

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
        if not self._knows():
            raise WorkFailed(f"no runtime answers on {self.url}; {START_IT}")
        self._answers.forget()
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
            self.status = None
            if self._signs():
                self._ask_signed(message.encode())
            else:
                self._answers.ask(channels.CRUX_PLAN_PIECE, message.encode())
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
