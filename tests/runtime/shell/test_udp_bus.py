"""The C++ end of the UDP bus against python-can, over real sockets."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator

import can
import pytest
from crux_simulation.sim.ports import BUS_GROUP, run_ports
from crux_tools.paths import built

COUNT = 200
LENGTHS = (0, 1, 7, 8, 12, 16, 20, 24, 32, 48, 64)
GARBAGE = (b"", b"\x8b", b"hello", bytes(range(256)) * 8)


@pytest.fixture
def port() -> Iterator[int]:
    with run_ports() as ports:
        yield ports.base


def test_frames_survive_both_directions(port: int) -> None:
    echo = subprocess.Popen(
        [str(built("tests/runtime/shell/bus_echo")), f"udp:{BUS_GROUP}:{port}", str(COUNT)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert echo.stdout is not None
    assert echo.stdout.readline() == "ready\n"
    sent = [
        can.Message(
            arbitration_id=2 * i if i % 3 else 0x10000 + 2 * i,
            is_extended_id=i % 3 == 0,
            data=bytes((i + k) % 256 for k in range(LENGTHS[i % len(LENGTHS)])),
            is_fd=True,
            bitrate_switch=i % 2 == 0,
            error_state_indicator=i % 5 == 0,
        )
        for i in range(COUNT)
    ]
    with can.Bus(interface="udp_multicast", channel=BUS_GROUP, port=port, hop_limit=0, fd=True) as bus:
        raw = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for datagram in GARBAGE:
            raw.sendto(datagram, (BUS_GROUP, port))
        raw.close()
        answers: list[can.Message] = []
        for message in sent:
            bus.send(message)
            while not answers or answers[-1].arbitration_id != message.arbitration_id + 1:
                try:
                    answer = bus.recv(2.0)
                except can.CanOperationError:  # the garbage, as python-can sees it
                    continue
                assert answer is not None, f"no answer to {message}"
                if answer.arbitration_id % 2 == 1:
                    answers.append(answer)
    for message, answer in zip(sent, answers, strict=True):
        assert bytes(answer.data) == bytes(255 - byte for byte in message.data)
        assert answer.is_extended_id == message.is_extended_id
        assert answer.bitrate_switch == message.bitrate_switch
        assert answer.error_state_indicator == message.error_state_indicator
        assert answer.is_fd
    output, _ = echo.communicate(timeout=600)
    assert output == f"{len(GARBAGE)} malformed\n"
    assert echo.returncode == 0
