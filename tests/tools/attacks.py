"""Attackers of a runtime and its operators, who have no key: `python attacks.py NAME URL` goes on until it is ended.

Each hears everything and sends what he likes; a burst, a pause, so that a machine of two cores does other things, too.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import random
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator

from crux_contracts import channels
from crux_msgs import acknowledgement_t, answer_t, command_t, plan_piece_t, signed_t, status_t
from crux_tools.lcm_socket import FRAGMENT, FRAGMENT_HEADER, WHOLE, WHOLE_HEADER, LcmSocket
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

BURST, PAUSE_S = 50, 0.002
SENDERS = 200
HUGE = 1 << 28  # bytes that a fragment's header claims
SIGNATURE_BYTES = 64
OF_TOOLS = (channels.CRUX_COMMAND, channels.CRUX_PLAN_PIECE, channels.CRUX_SIGNED)


class Attacker:
    """A socket as anybody has it."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.link = LcmSocket(url)
        self.draw = random.Random(1)

    def heard(self, timeout_s: float, *names: str) -> tuple[str, bytes] | None:
        """The next message of others on these channels."""
        found = self.link.receive(timeout_s, lambda channel, _data: channel in names)
        return None if found is None else found[:2]

    def in_bursts(self) -> Iterator[int]:
        """Counts, with a pause after each burst."""
        for number in itertools.count():
            yield number
            if number % BURST == BURST - 1:
                time.sleep(PAUSE_S)


def fragments(attacker: Attacker) -> None:
    """132 bytes each that say they are the first of 256 MiB."""
    for number in attacker.in_bursts():
        header = FRAGMENT_HEADER.pack(FRAGMENT, number & 0xFFFFFFFF, HUGE, 0, 0, 65535)
        attacker.link._out.sendto(header + b"CRUX_SIGNED\0" + bytes(100), attacker.link._to)


def garbage(attacker: Attacker) -> None:
    """Bytes that mean nothing, on every channel; some begin as a message of its type does."""
    starts = {name: getattr(sys.modules["crux_msgs"], kind)().encode()[:8] for name, kind in TYPES.items()}
    for number, (name, start) in zip(attacker.in_bursts(), itertools.cycle(starts.items()), strict=False):
        attacker.link.publish(name, (start if number % 2 else b"") + attacker.draw.randbytes(20))


def forged_answers(attacker: Attacker) -> None:
    """To all that operators send: signed with a key of his own, or as if by the key that answered last."""
    own, real = Ed25519PrivateKey.generate(), bytes(32)
    while True:
        heard = attacker.heard(1.0, *OF_TOOLS, channels.CRUX_ANSWER)
        if heard is None:
            continue
        channel, data = heard
        if channel == channels.CRUX_ANSWER:
            real = data[8:40]
            continue
        for key in (own.public_key().public_bytes_raw(), real):
            answer = _lie(data, key)
            content = answer.encode()[:-SIGNATURE_BYTES]
            forged = content + (own.sign(content) if key != real else os.urandom(SIGNATURE_BYTES))
            for _ in range(BURST):
                attacker.link.publish(channels.CRUX_ANSWER, forged)


def _lie(request: bytes, key: bytes) -> answer_t:
    answer, status = answer_t(), status_t()
    answer.key, answer.request, answer.signature = key, hashlib.sha256(request).digest(), bytes(SIGNATURE_BYTES)
    answer.acknowledgement = acknowledgement_t()
    status.session, status.lease, status.lease_s = 1, 2**63 - 2, 1e300
    answer.n_status, answer.status = 1, [status]
    answer.acknowledgement.subject = acknowledgement_t.COMMAND
    for kind, data in ((command_t, request), (command_t, bytes(_data_of(request)))):
        try:
            answer.acknowledgement.request_id = kind.decode(data).request_id
        except (ValueError, struct.error):
            continue
    return answer


def _data_of(request: bytes) -> bytes:
    try:
        return bytes(signed_t.decode(request).data)
    except (ValueError, struct.error):
        return b""


def _stolen_hold(attacker: Attacker) -> bytes:
    """Of an operator, as it was heard."""
    while True:
        heard = attacker.heard(1.0, channels.CRUX_SIGNED)
        if heard is not None and (data := _data_of(heard[1])) and command_t.decode(data).command == command_t.HOLD:
            return heard[1]


def forged_holds(attacker: Attacker) -> None:
    """An operator's, with another signature each, from many sockets: each costs the runtime a look at it."""
    hold = _stolen_hold(attacker)
    senders = [LcmSocket(attacker.url) for _ in range(SENDERS)]
    for _, sender in zip(attacker.in_bursts(), itertools.cycle(senders), strict=False):
        sender.publish(channels.CRUX_SIGNED, hold[:-SIGNATURE_BYTES] + attacker.draw.randbytes(SIGNATURE_BYTES))


def new_senders(attacker: Attacker) -> None:
    """The same, each from a socket that nobody has seen before."""
    hold = _stolen_hold(attacker)
    for number in attacker.in_bursts():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            forged = hold[:-SIGNATURE_BYTES] + attacker.draw.randbytes(SIGNATURE_BYTES)
            head = WHOLE_HEADER.pack(WHOLE, number & 0xFFFFFFFF) + channels.CRUX_SIGNED.encode() + b"\0"
            sender.sendto(head + forged, attacker.link._to)


def replayed_holds(attacker: Attacker) -> None:
    """An operator's, as it was."""
    hold = _stolen_hold(attacker)
    for _ in attacker.in_bursts():
        attacker.link.publish(channels.CRUX_SIGNED, hold)


def questions(attacker: Attacker) -> None:
    """Each is answered."""
    message = command_t()
    message.command = command_t.STATUS
    for number in attacker.in_bursts():
        message.request_id = number
        attacker.link.publish(channels.CRUX_COMMAND, message.encode())


def pieces(attacker: Attacker) -> None:
    """Of plans that never come to their end, as large as they may be."""
    piece = plan_piece_t()
    piece.n_pieces, piece.total_bytes = 100, 100 * plan_piece_t.MAX_BYTES
    piece.n_bytes, piece.data = plan_piece_t.MAX_BYTES, bytes(plan_piece_t.MAX_BYTES)
    for number in attacker.in_bursts():
        piece.transfer_id = number
        attacker.link.publish(channels.CRUX_PLAN_PIECE, piece.encode())


TYPES = {channel.name: channel.type for channel in channels.CHANNELS}
ATTACKS: dict[str, Callable[[Attacker], None]] = {
    each.__name__: each
    for each in (fragments, garbage, forged_answers, forged_holds, new_senders, replayed_holds, questions, pieces)
}

if __name__ == "__main__":
    attacker = Attacker(sys.argv[2])
    print("here", flush=True)
    ATTACKS[sys.argv[1]](attacker)
