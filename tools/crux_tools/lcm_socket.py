"""LCM over UDP multicast, by a socket of our own: whatever comes, its memory is bounded and its senders are told apart.

The library takes the memory that any fragment's header asks for, and keeps thirty messages of a channel, anybody's.
"""

from __future__ import annotations

import contextlib
import itertools
import re
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from crux_tools.errors import UsageError

NO_NETWORK = "without a network, as root: ip link set lo up && ip route add 224.0.0.0/4 dev lo"
Sender = tuple[str, int]
Heard = tuple[str, bytes, Sender]
URL = re.compile(r"udpm://(?P<group>[\d.]+):(?P<port>\d+)(\?(.*&)?(ttl=(?P<ttl>\d+)|\w+=\w*)(&.*)?)?")
WHOLE, FRAGMENT = 0x4C433032, 0x4C433033  # "LC02", "LC03"
WHOLE_HEADER, FRAGMENT_HEADER = struct.Struct(">II"), struct.Struct(">IIIIHH")
LONGEST_WHOLE, FRAGMENT_BYTES, DATAGRAM = 65499, 65487, 65536
RECEIVE_BYTES = 8 << 20  # the kernel gives as much as it may
PARTS = 4  # messages that may be incomplete at a time


@dataclass
class Fragments:
    """Puts messages of several datagrams together; what they have not sent yet takes no memory.

    A message of more than `longest` bytes is ignored; of incomplete ones the oldest goes when a fifth comes.
    """

    longest: int
    _parts: dict[tuple[Sender, int], dict[int, bytes]] = field(default_factory=dict, init=False)

    def put(self, datagram: bytes, sender: Sender) -> bytes | None:
        """Channel, a zero byte and the message's bytes, where this was the last one of them."""
        if len(datagram) <= FRAGMENT_HEADER.size:
            return None
        _, number, size, _, index, count = FRAGMENT_HEADER.unpack_from(datagram)
        if size > self.longest or not index < count <= 1 + (size + LONGEST_WHOLE) // FRAGMENT_BYTES:
            return None
        if (sender, number) not in self._parts and len(self._parts) == PARTS:
            del self._parts[next(iter(self._parts))]
        parts = self._parts.setdefault((sender, number), {})
        parts.setdefault(index, datagram[FRAGMENT_HEADER.size :])
        if len(parts) < count:
            return None
        whole = b"".join(part for _, part in sorted(self._parts.pop((sender, number)).items()))
        return whole if len(whole) - whole.find(b"\0") - 1 == size else None


class LcmSocket:
    """Sends and receives; where `longest` is 0 no message of several datagrams is received."""

    def __init__(self, url: str, longest: int = 0) -> None:
        """Raises UsageError."""
        found = URL.fullmatch(url)
        try:
            if found is None:
                raise OSError("right is for example udpm://239.255.76.67:7667?ttl=0")
            self._to = found["group"], int(found["port"])
            self._open(int(found["ttl"] or 0))
        except (OSError, OverflowError) as error:
            self.close()
            raise UsageError(f"cannot open LCM at {url}: {error} ({NO_NETWORK})") from error
        self._numbers = itertools.count()
        self._fragments = Fragments(longest)

    def _open(self, ttl: int) -> None:
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, ttl)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.setblocking(False)
        for option in (socket.SO_REUSEADDR, socket.SO_REUSEPORT):  # LCM's programs share the port
            self._in.setsockopt(socket.SOL_SOCKET, option, 1)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
        self._in.bind(self._to)
        group = socket.inet_aton(self._to[0]) + socket.inet_aton("0.0.0.0")
        self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)

    def __enter__(self) -> LcmSocket:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives its sockets back."""
        for each in (getattr(self, "_in", None), getattr(self, "_out", None)):
            if each is not None:
                each.close()

    def publish(self, channel: str, data: bytes) -> None:
        """Sends a message, in several datagrams where it does not fit one. Raises UsageError where there is no way."""
        number, whole = next(self._numbers) & 0xFFFFFFFF, channel.encode() + b"\0" + data
        datagrams = [WHOLE_HEADER.pack(WHOLE, number) + whole]
        if len(whole) > LONGEST_WHOLE:
            cuts = range(0, len(whole), FRAGMENT_BYTES)
            datagrams = [
                FRAGMENT_HEADER.pack(
                    FRAGMENT, number, len(data), max(0, at - len(channel) - 1), index, len(cuts)
                ) + whole[at : at + FRAGMENT_BYTES]
                for index, at in enumerate(cuts)
            ]  # fmt: skip
        for datagram in datagrams:
            try:
                self._out.sendto(datagram, self._to)
            except OSError as error:
                raise UsageError(f"cannot send to {self._to[0]}:{self._to[1]}: {error} ({NO_NETWORK})") from error

    def receive(
        self, timeout_s: float, wanted: Callable[[str, bytes], bool] = lambda _channel, _data: True
    ) -> Heard | None:
        """The next message that is wanted, with its sender; None when none has come in time."""
        end_s = time.monotonic() + timeout_s
        while True:
            try:
                datagram, sender = self._in.recvfrom(DATAGRAM)
            except BlockingIOError:
                left_s = end_s - time.monotonic()
                if left_s <= 0 or not select_readable(self._in, left_s):
                    return None
                continue
            if (heard := self._read(datagram, sender)) is not None and wanted(heard[0], heard[1]):
                return heard
            if time.monotonic() >= end_s:
                return None

    def _read(self, datagram: bytes, sender: Sender) -> Heard | None:
        magic = int.from_bytes(datagram[:4], "big")
        whole: bytes | None = None
        if magic == WHOLE:
            whole = datagram[WHOLE_HEADER.size :]
        elif magic == FRAGMENT and self._fragments.longest:
            whole = self._fragments.put(datagram, sender)
        end = -1 if whole is None else whole.find(b"\0")
        if whole is None or end < 0:
            return None
        with contextlib.suppress(UnicodeDecodeError):
            return whole[:end].decode("ascii"), whole[end + 1 :], sender
        return None


def select_readable(each: socket.socket, timeout_s: float) -> bool:
    """Whether something comes in time; poll() knows no highest descriptor."""
    poll = select.poll()
    poll.register(each, select.POLLIN)
    return bool(poll.poll(max(1, round(1000 * timeout_s))))
