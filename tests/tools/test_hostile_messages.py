"""Whatever comes over LCM, an operator's programs live on, hear the next good message, and keep bounded memory.

Hypothesis draws bytes and damages messages of every type; the sweep does so ten million times (CRUX_FUZZ_PACKETS).
"""

from __future__ import annotations

import os
import random
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import crux_msgs
import pytest
from crux_contracts import channels
from crux_contracts.lcm_bytes import decoded
from crux_msgs import acknowledgement_t, command_t, fault_t, robot_state_t
from crux_msgs.tables import MEMBERS
from crux_simulation.sim.ports import run_ports
from crux_tools.answers import SENDERS, WAITING, Answers
from crux_tools.known_runtimes import KnownRuntime
from crux_tools.lcm_socket import FRAGMENT, FRAGMENT_HEADER, WHOLE, WHOLE_HEADER, Fragments, LcmSocket
from crux_tools.view.live import MOST_TOLD, QUEUED_BYTES, Live
from fake_runtime import own_runtime_key, signed_answer
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn
from made_up_climb import made_up_plan

TYPES = sorted(MEMBERS)
SENT = sorted(channel.type for channel in channels.CHANNELS)
URL = "udpm://239.255.76.67:1?ttl=0"
SENDER = ("127.0.0.1", 1)


def made(type_name: str, number: Callable[[str], Any], length: int) -> Any:
    """A message with every sequence of `length`; `number` gives what a primitive type has."""
    message = getattr(crux_msgs, type_name)()
    lengths = {dimension for _, _, dimension in MEMBERS[type_name] if isinstance(dimension, str)}
    for name, kind, dimension in MEMBERS[type_name]:
        count = length if isinstance(dimension, str) else dimension
        if name in lengths:
            setattr(message, name, length)
        elif kind == "byte":
            setattr(message, name, bytes(count or 0) if dimension is not None else 0)
        elif count is None:
            setattr(message, name, made(kind, number, length) if kind in MEMBERS else number(kind))
        else:
            values = [made(kind, number, length) if kind in MEMBERS else number(kind) for _ in range(count)]
            setattr(message, name, values)
    return message


def wild(draw: random.Random) -> Callable[[str], Any]:
    """Numbers as nobody means them."""
    doubles = (0.0, -1.0, 1e-300, 1e9, 1e300, float("inf"), float("-inf"), float("nan"))
    bits = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}

    def number(kind: str) -> Any:
        if kind in bits:
            top = 1 << (bits[kind] - 1)
            return draw.choice((0, 1, -1, 3, 77, top - 1, -top))
        if kind == "string":
            return draw.choice(("", "a", "\x1b[31m", "ü" * 50))
        value = draw.choice(doubles)
        return 1e30 if kind == "float" and value == 1e300 else value

    return number


def damaged(data: bytes, draw: random.Random) -> bytes:
    """Some bytes changed, cut or added; often none."""
    changed = bytearray(data)
    for _ in range(draw.choice((0, 0, 1, 2, 8))):
        if changed:
            changed[draw.randrange(len(changed))] = draw.choice((0, 1, 127, 128, 255, draw.randrange(256)))
    if draw.random() < 0.2:
        del changed[draw.randrange(len(changed) + 1) :]
    return bytes(changed) + (draw.randbytes(draw.randrange(40)) if draw.random() < 0.1 else b"")


@st.composite
def messages(draw: DrawFn, types: list[str]) -> tuple[str, bytes]:
    """Of a type, and bytes for it."""
    name = draw(st.sampled_from(types))
    if draw(st.booleans()):
        start = getattr(crux_msgs, name)().encode()[:8] if draw(st.booleans()) else b""
        return name, start + draw(st.binary(max_size=200))
    chosen = random.Random(draw(st.integers(0, 2**32)))
    return name, damaged(made(name, wild(chosen), chosen.randrange(3)).encode(), chosen)


@given(messages(TYPES))
def test_bytes_are_a_message_or_none(drawn: tuple[str, bytes]) -> None:
    name, data = drawn
    with suppress(ValueError):
        assert decoded(getattr(crux_msgs, name), data).encode() == data


def test_what_lcm_gen_reads_as_whole_is_none() -> None:
    whole = command_t().encode()
    for data in (whole[:-9], whole + b"\0", b"", whole[:8], bytes(20)):
        with pytest.raises(ValueError, match="no command_t"):
            decoded(command_t, data)


class Packets:
    """In place of an LcmSocket: what is put comes."""

    def __init__(self) -> None:
        self.coming: list[tuple[bytes, Any]] = []
        self.sent: list[bytes] = []

    def publish(self, _channel: str, data: bytes) -> None:
        self.sent.append(data)

    def receive(self, _timeout_s: float, wanted: Callable[[str, bytes], bool]) -> tuple[str, bytes, Any] | None:
        while self.coming:
            data, sender = self.coming.pop(0)
            if wanted(channels.CRUX_ANSWER, data):
                return channels.CRUX_ANSWER, data, sender
        return None


@pytest.fixture(scope="module")
def answers() -> Answers:
    own_runtime_key()
    return Answers(Packets(), KnownRuntime(URL))


def good_answer(request: bytes) -> bytes:
    acknowledgement = acknowledgement_t()
    acknowledgement.request_id = 7
    return signed_answer(own_runtime_key(), request, acknowledgement)


def expect_the_good_one(answers: Answers, between: list[tuple[bytes, Any]]) -> None:
    """It comes behind others, and is found; nothing else is believed."""
    answers.forget()
    request = b"asked"
    answers.ask(channels.CRUX_COMMAND, request)
    good = good_answer(request)
    answers.link.coming = [*between, (good, SENDER)]
    found = answers.next(lambda _: True, 60.0)
    assert found is not None
    assert found.encode() == good


@given(st.lists(st.integers(0, 2**32), max_size=8))
def test_no_damaged_answer_is_believed(answers: Answers, seeds: list[int]) -> None:
    good = good_answer(b"asked")
    bad = [damaged(good, random.Random(seed)) for seed in seeds]
    expect_the_good_one(answers, [(data, ("10.0.0.1", i)) for i, data in enumerate(bad) if data != good])


def test_a_flood_of_forged_answers_delays_the_good_one_by_one_a_sender(answers: Answers) -> None:
    good = good_answer(b"asked")
    forged = good[:-64] + bytes(64)
    expect_the_good_one(answers, [(forged, ("10.0.0.1", i % 20)) for i in range(20_000)])
    assert sum(map(len, answers._waiting.values())) == answers._n_waiting <= WAITING + SENDERS


def test_an_old_answer_fits_no_new_question(answers: Answers) -> None:
    answers.forget()
    answers.ask(channels.CRUX_COMMAND, b"new")
    answers.link.coming = [(good_answer(b"old"), SENDER)]
    assert answers.next(lambda _: True, 0.05) is None


@given(st.lists(st.binary(max_size=300), max_size=20))
def test_fragments_of_any_kind_take_bounded_memory(payloads: list[bytes]) -> None:
    fragments = Fragments(1000)
    for data in payloads:
        fragments.put(WHOLE_HEADER.pack(FRAGMENT, 1) + data, SENDER)
        assert sum(len(part) for parts in fragments._parts.values() for part in parts.values()) <= 4 * 70_000


def test_a_header_takes_no_memory() -> None:
    fragments = Fragments(8 << 20)
    for number in range(1000):
        header = FRAGMENT_HEADER.pack(FRAGMENT, number, 1 << 28, 0, 0, 65535)
        assert fragments.put(header + b"CRUX_PLAN\0" + bytes(100), SENDER) is None
        assert not any((SENDER, number) == each for each in fragments._parts)
        assert fragments.put(FRAGMENT_HEADER.pack(FRAGMENT, number, 8 << 20, 0, 0, 129) + bytes(100), SENDER) is None
    assert sum(len(part) for parts in fragments._parts.values() for part in parts.values()) <= 400


@pytest.mark.parametrize("size", [0, 1, 65_000, 65_499, 65_500, 200_000, 8 << 20])
def test_messages_of_any_size_arrive_as_they_were(size: int) -> None:
    data = random.Random(size).randbytes(size)
    with run_ports() as ports, LcmSocket(ports.lcm_url) as sender, LcmSocket(ports.lcm_url, 8 << 20) as receiver:
        sent: list[bytes] = []
        sender._out.close()
        sender._out = type("Kept", (), {"sendto": lambda _, part, _to: sent.append(part), "close": lambda _: None})()
        sender.publish("CRUX_PLAN", data)
        random.Random(1).shuffle(sent)
        heard = [receiver._read(part, SENDER) for part in sent]
        assert [each[:2] for each in heard if each is not None] == [("CRUX_PLAN", data)]
        assert all(len(part) <= 65_507 for part in sent)


@pytest.fixture(scope="module")
def live() -> Iterator[Live]:
    """Nobody else speaks at its address."""
    with run_ports() as ports:
        live = Live(ports.lcm_url, made_up_plan())
        live._takers.pop(channels.CRUX_PLAN)  # hostile plans: below
        yield live


def expect_to_go_on(live: Live) -> None:
    """It shows the next two good states."""
    live._clear()
    first = live._states.count
    for cycle in (1, 2):
        for channel, kind in (
            (channels.CRUX_LIMB_REFERENCE, "limb_reference_t"),
            (channels.CRUX_LIMB_TELEMETRY, "limb_telemetry_t"),
        ):
            for limb in range(4):
                message = made(kind, lambda kind: 0 if kind.startswith("int") else 0.0, 0)
                message.limb = limb
                live.take(channel, message.encode())
        state = made("robot_state_t", lambda kind: 0 if kind.startswith("int") else 0.0, 0)
        state.cycle, state.time_s, state.body_quaternion_w = cycle, 0.02 * cycle, [1.0, 0.0, 0.0, 0.0]
        live.take(channels.CRUX_ROBOT_STATE, state.encode())
    assert live._states.count >= first


@settings(max_examples=15)
@given(st.lists(messages([kind for kind in SENT if kind != "plan_t"]), max_size=12))
def test_a_watcher_lives_on(live: Live, drawn: list[tuple[str, bytes]]) -> None:
    names = {channel.type: channel.name for channel in channels.CHANNELS if channel.name in live._takers}
    for kind, data in drawn:
        if kind in names:
            live.take(names[kind], data)
    if live._states.count:
        live.recording()
    expect_to_go_on(live)


def test_a_malformed_fault_ends_no_watcher_and_is_counted() -> None:
    with run_ports() as ports, LcmSocket(ports.lcm_url) as attacker:
        live = Live(ports.lcm_url, made_up_plan())
        attacker.publish(channels.CRUX_FAULT, b"12345678901234567890")
        attacker.publish(channels.CRUX_FAULT, fault_t().encode())
        end_s = time.monotonic() + 600
        while live._faults.count == 0 and time.monotonic() < end_s:
            time.sleep(0.01)
        assert (live._faults.count, live.ignored) == (1, 1)


def test_what_a_watcher_keeps_is_bounded(live: Live) -> None:
    ignored = live.ignored
    fault, command = fault_t().encode(), command_t().encode()
    for _ in range(MOST_TOLD + 10):
        live.take(channels.CRUX_FAULT, fault)
        live.take(channels.CRUX_COMMAND, command)
    assert live._faults.count <= MOST_TOLD
    assert len(live._told.messages["/command"]) == len(live._told.times_ns["/command"]) == MOST_TOLD
    assert live.ignored == ignored
    assert live._queued_bytes <= QUEUED_BYTES
    for number in (float("nan"), 1e300):
        state = robot_state_t()
        state.time_s, state.body_quaternion_w = number, [1.0, 0.0, 0.0, 0.0]
        live.take(channels.CRUX_ROBOT_STATE, state.encode())
    assert live.ignored == ignored + 2


def test_a_plan_that_is_no_wall_ends_no_watcher() -> None:
    with run_ports() as ports:
        live = Live(ports.lcm_url, None)
        draw = random.Random(3)
        for length in (0, 1, 2):
            for _ in range(10):
                live.take(channels.CRUX_PLAN, made("plan_t", wild(draw), length).encode())
        assert live.ignored == 30
        live.take(channels.CRUX_PLAN, made_up_plan().encode())
        assert live._robot is not None


@pytest.mark.sweep
def test_ten_million_packets(answers: Answers, live: Live) -> None:
    packets = int(os.environ.get("CRUX_FUZZ_PACKETS", "10000000"))
    draw = random.Random(20260103)
    sound = {kind: [made(kind, wild(draw), length).encode() for length in (0, 1, 2)] for kind in TYPES}
    names = {channel.type: channel.name for channel in channels.CHANNELS if channel.name in live._takers}
    for number in range(packets):
        kind = draw.choice(TYPES)
        data = damaged(draw.choice(sound[kind]), draw)
        with suppress(ValueError):
            decoded(getattr(crux_msgs, kind), data)
        if kind in names:
            live.take(names[kind], data)
        datagram = struct.pack(">I", draw.choice((WHOLE, FRAGMENT))) + data
        live._lcm._read(datagram, SENDER)
        if number % 1000 == 0:
            expect_the_good_one(answers, [(damaged(good_answer(b"asked")[:-1], draw), SENDER) for _ in range(5)])
            live.recording() if live._states.count else None
            live._clear()
    expect_to_go_on(live)
