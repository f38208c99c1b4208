"""A runtime's LCM side for tests: takes plans and commands, answers as told."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from crux_contracts import channels
from crux_msgs import acknowledgement_t, answer_t, command_t, fault_t, plan_piece_t, plan_t, signed_t, status_t
from crux_tools.lcm_socket import LcmSocket
from crux_tools.signing_key import new_key, read_key

SIGNATURE_BYTES = 64


def own_runtime_key() -> Path:
    """Of the runtimes that this user starts; made where there is none."""
    path = Path(os.environ["XDG_STATE_HOME"]) / "crux" / "runtime.pem"
    path.parent.mkdir(exist_ok=True)
    with suppress(FileExistsError):
        new_key(path)
    return path


def signed_answer(key: Path, request: bytes, acknowledgement: acknowledgement_t, *status: status_t) -> bytes:
    """An encoded answer_t to a message."""
    private, answer = read_key(key), answer_t()
    answer.key, answer.request = private.public_key().public_bytes_raw(), hashlib.sha256(request).digest()
    answer.acknowledgement, answer.n_status, answer.status = acknowledgement, len(status), list(status)
    answer.signature = bytes(SIGNATURE_BYTES)
    content = answer.encode()[:-SIGNATURE_BYTES]
    return content + private.sign(content)


class FakeRuntime:
    """Listens in a thread of its own while the context lasts; `lose` messages are ignored at first."""

    def __init__(self, url: str, refuse_plan: str = "", refuse_commands: str = "", lose: int = 0) -> None:
        self._url = url
        self._refuse_plan = refuse_plan
        self._refuse_commands = refuse_commands
        self._lose = lose
        self.tells_status = True
        self._pieces: dict[int, bytes] = {}
        self._stop = threading.Event()
        self._ready = threading.Event()
        self.plan: plan_t | None = None
        self.commands: list[command_t] = []

    def __enter__(self) -> FakeRuntime:
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()
        assert self._ready.wait(600)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _listen(self) -> None:
        take: dict[str, Callable[[bytes], None]] = {
            channels.CRUX_PLAN_PIECE: self._on_piece,
            channels.CRUX_COMMAND: lambda data: self._on_command(data, data),
            channels.CRUX_SIGNED: lambda data: self._on_command(bytes(signed_t.decode(data).data), data),
        }
        self._key = own_runtime_key()
        with LcmSocket(self._url) as self._lcm:
            self._ready.set()
            while not self._stop.is_set():
                if (heard := self._lcm.receive(0.02, lambda channel, _: channel in take)) is not None:
                    take[heard[0]](heard[1])

    def _loses(self) -> bool:
        self._lose -= 1
        return self._lose >= 0

    def _answer(
        self, data: bytes, subject: int, request_id: int, piece: int = -1, reason: str = "", *status: status_t
    ) -> None:
        answer = acknowledgement_t()
        answer.subject = subject
        answer.request_id = request_id
        answer.piece = piece
        answer.verdict = acknowledgement_t.REFUSED if reason else acknowledgement_t.ACCEPTED
        answer.supervisor_state = 1
        answer.plan_id = self.plan.plan_id if self.plan else ""
        answer.reason = reason
        self._lcm.publish(channels.CRUX_ANSWER, signed_answer(self._key, data, answer, *status))

    def _on_piece(self, data: bytes) -> None:
        if self._loses():
            return
        piece = plan_piece_t.decode(data)
        self._pieces[piece.piece] = bytes(piece.data)
        self._answer(data, acknowledgement_t.PLAN_PIECE, piece.transfer_id, piece.piece)
        if len(self._pieces) < piece.n_pieces:
            return
        whole = b"".join(self._pieces[i] for i in range(piece.n_pieces))
        assert hashlib.sha256(whole).hexdigest() == piece.bytes_sha256
        if not self._refuse_plan:
            self.plan = plan_t.decode(whole)
        self._answer(data, acknowledgement_t.PLAN, piece.transfer_id, reason=self._refuse_plan)

    def _on_command(self, data: bytes, request: bytes) -> None:
        if self._loses():
            return
        command = command_t.decode(data)
        self.commands.append(command)
        told = []
        if command.command == command_t.STATUS and self.tells_status:
            status = status_t()
            status.fault, status.insecure = fault_t(), 1
            told = [status]
        self._answer(request, acknowledgement_t.COMMAND, command.request_id, -1, self._refuse_commands, *told)
