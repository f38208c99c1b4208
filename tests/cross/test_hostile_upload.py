"""Hostile bytes on the runtime's LCM channels: it refuses with a reason, lives on, and then takes a good plan."""

from __future__ import annotations

import hashlib
import math
import random
import struct
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import lcm
import pytest
from crux_contracts import channels
from crux_contracts.plan_file import plan_id, read_plan
from crux_contracts.robot import load_robot
from crux_msgs import acknowledgement_t, command_t, plan_piece_t, plan_t
from crux_simulation.sim.ports import run_ports
from crux_simulation.sim.runtime_process import START_TRIES, START_TRY_S
from crux_tools.errors import UsageError
from crux_tools.operator_link import OperatorLink
from crux_tools.paths import built

SEED = 7
SILENCE_MS = 400
TRANSFERS = 10_000_000
HASH_BYTES = 8  # every LCM message begins with the hash of its type


class Target:
    """A runtime, an operator's line to it and the attacker's own."""

    def __init__(self, process: subprocess.Popen[bytes], link: OperatorLink) -> None:
        self.process = process
        self.link = link
        self._attacker = lcm.LCM(link.url)
        self._answers: list[acknowledgement_t] = []
        self._attacker.subscribe(channels.CRUX_ACKNOWLEDGEMENT, self._keep).set_queue_capacity(0)  # 0: no bound

    def _keep(self, _channel: str, data: bytes) -> None:
        self._answers.append(acknowledgement_t.decode(data))

    def send(self, channel: str, data: bytes) -> None:
        """Publishes any bytes."""
        self._attacker.publish(channel, data)

    def answers_to(self, transfer_id: int) -> list[acknowledgement_t]:
        """What the runtime says to a transfer until it is silent for a while."""
        self._answers.clear()
        while self._attacker.handle_timeout(SILENCE_MS) > 0:
            pass
        return [answer for answer in self._answers if answer.request_id == transfer_id]

    def upload(self, data: bytes, transfer_id: int) -> list[acknowledgement_t]:
        """Uploads any bytes as if they were a plan; the runtime's answers."""
        size = plan_piece_t.MAX_BYTES
        cuts = [data[at : at + size] for at in range(0, len(data), size)]
        digest = hashlib.sha256(data).hexdigest()
        for index, cut in enumerate(cuts):
            whole = {"total_bytes": len(data), "n_pieces": len(cuts), "piece": index, "bytes_sha256": digest}
            self.send(channels.CRUX_PLAN_PIECE, _piece(cut, transfer_id, **whole).encode())
        return self.answers_to(transfer_id)

    def assert_alive(self) -> None:
        """It still answers its operators."""
        assert self.process.poll() is None
        assert self.link.command(command_t.STATUS) is not None, "the runtime does not answer any more"


@pytest.fixture(scope="module")
def target(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Target]:
    """One runtime for all attacks: what one of them broke the next would see."""
    with ExitStack() as stack:
        ports = stack.enter_context(run_ports())
        buses = [f"{name}={url}" for name, url in zip(("LF", "RF", "LR", "RR"), ports.bus_urls(), strict=True)]
        command = [str(built("runtime/app/crux-runtime")), "--robot", str(load_robot("scaler").folder), "--pace", "bus"]
        command += [
            "--insecure",
            "--lcm",
            ports.lcm_url,
            "--log",
            str(tmp_path_factory.mktemp("runtime") / "telemetry.mcap"),
        ]
        process = subprocess.Popen(command + [word for bus in buses for word in ("--bus", bus)])
        stack.callback(process.wait)
        stack.callback(process.kill)
        link = stack.enter_context(OperatorLink(ports.lcm_url))
        assert link.command(command_t.STATUS, tries=START_TRIES, timeout_s=START_TRY_S) is not None
        yield Target(process, link)


@pytest.fixture
def good(plan_path: Path) -> plan_t:
    return read_plan(plan_path)


def _piece(data: bytes, transfer_id: int, **changes: Any) -> plan_piece_t:
    piece = plan_piece_t()
    piece.transfer_id, piece.plan_id = transfer_id, "ab" * 32
    piece.bytes_sha256 = hashlib.sha256(data).hexdigest()
    piece.total_bytes, piece.n_pieces, piece.piece = len(data), 1, 0
    piece.n_bytes, piece.data = len(data), data
    for name, value in changes.items():
        setattr(piece, name, value)
    return piece


def test_garbage_on_every_channel(target: Target, good: plan_t) -> None:
    draw = random.Random(SEED)
    command = command_t()
    command.plan_id = "x"
    for channel, sound in (
        (channels.CRUX_PLAN_PIECE, _piece(good.encode()[:1000], 1).encode()),
        (channels.CRUX_COMMAND, command.encode()),
    ):
        kind = sound[:HASH_BYTES]
        attacks = [b"", b"\0", kind, kind + b"\xff" * 100, sound[:-1], sound + b"\0", sound[: len(sound) // 2]]
        attacks += [kind + draw.randbytes(draw.randrange(2000)) for _ in range(100)]
        for _ in range(100):
            flipped = bytearray(sound)
            flipped[draw.randrange(HASH_BYTES, len(sound))] ^= 1 << draw.randrange(8)
            attacks.append(bytes(flipped))
        for attack in attacks:
            target.send(channel, attack)
        target.assert_alive()


@pytest.mark.parametrize(
    "changes",
    [
        {"n_pieces": 0},
        {"n_pieces": -1},
        {"n_pieces": 2**31 - 1},
        {"piece": -1},
        {"piece": 1},
        {"piece": 2**31 - 1},
        {"total_bytes": -1},
        {"total_bytes": 0},
        {"total_bytes": 2**31 - 1},
        {"bytes_sha256": "0" * 64},
        {"bytes_sha256": ""},
        {"bytes_sha256": "z" * 100_000},
        {"plan_id": "p" * 50_000},
    ],
    ids=lambda changes: ", ".join(f"{key} {str(value)[:12]}" for key, value in changes.items()),
)
def test_pieces_that_contradict_themselves(target: Target, good: plan_t, changes: dict[str, object]) -> None:
    number = 1000 + int(hashlib.sha256(repr(changes).encode()).hexdigest()[:8], 16)
    for attempt in range(20):  # the answer about the plan comes later on a busy machine, or is lost
        if attempt % 4 == 0:
            number += 1
            target.send(channels.CRUX_PLAN_PIECE, _piece(good.encode()[:5000], number, **changes).encode())
            answers = []  # none at all where the message does not even say what it belongs to
        answers += target.answers_to(number)
        if not answers or answers[-1].verdict != acknowledgement_t.ACCEPTED:
            break
    if answers:
        assert answers[-1].verdict == acknowledgement_t.REFUSED
        assert answers[-1].reason
    assert not [a for a in answers if (a.subject, a.verdict) == (acknowledgement_t.PLAN, acknowledgement_t.ACCEPTED)]
    target.assert_alive()


def test_a_flood_of_transfers_that_never_end(target: Target) -> None:
    for number in range(300):
        message = _piece(bytes(1000), 50_000 + number, total_bytes=30_000_000, n_pieces=500)
        target.send(channels.CRUX_PLAN_PIECE, message.encode())
    target.assert_alive()


def _declare_too_many_knots(data: bytearray, good: plan_t) -> None:
    knots, good.knots, good.n_knots = good.knots, [], 0
    count_ends = len(good.encode())  # without knots their count is the last thing in it
    good.knots, good.n_knots = knots, len(knots)
    data[count_ends - 4 : count_ends] = struct.pack(">i", 2**31 - 1)


def _cut(data: bytearray, _good: plan_t) -> None:
    del data[len(data) // 2 :]


def _lengthen(data: bytearray, _good: plan_t) -> None:
    data.extend(b"\0" * 64)


@pytest.mark.parametrize("damage", [_declare_too_many_knots, _cut, _lengthen])
def test_plan_bytes_that_do_not_decode(
    target: Target, good: plan_t, damage: Callable[[bytearray, plan_t], None]
) -> None:
    data = bytearray(good.encode())
    damage(data, good)
    last = target.upload(bytes(data), TRANSFERS + len(data))[-1]
    assert (last.subject, last.verdict) == (acknowledgement_t.PLAN, acknowledgement_t.REFUSED)
    assert last.reason
    target.assert_alive()


def _set(name: str, value: object) -> Callable[[plan_t], None]:
    return lambda plan: setattr(plan, name, value)


def _limb(name: str, value: object) -> Callable[[plan_t], None]:
    """Of a limb that holds on at that knot and beside it."""

    def change(plan: plan_t) -> None:
        holds = [limb for limb in range(4) if not any(knot.limbs[limb].phase for knot in plan.knots[2:5])]
        setattr(plan.knots[3].limbs[holds[0]], name, value)

    return change


def _knot(name: str, value: object) -> Callable[[plan_t], None]:
    return lambda plan: setattr(plan.knots[3], name, value)


BAD_PLANS: dict[str, Callable[[plan_t], None]] = {
    "another robot": _set("robot_name", "spider"),
    "another build of the robot": _set("robot_sha256", "0" * 64),
    "another format": _set("format", 99),
    "no time between knots": _set("dt_s", 0.0),
    "time backwards": _set("dt_s", -1.0),
    "time is NaN": _set("dt_s", math.nan),
    "gravity is infinite": _set("gravity_w_m_s2", [0.0, 0.0, -math.inf]),
    "body is NaN": _knot("body_position_w_m", [math.nan, 0.0, 0.2]),
    "body a kilometre away": _knot("body_position_w_m", [1000.0, 0.0, 0.2]),
    "a hold that is not there": _limb("hold", 32_000),
    "a phase that is not there": _limb("phase", 77),
    "a gripper out of reach": _limb("gripper_position_w_m", [5.0, 5.0, 5.0]),
    "a gripper yaw of 1e300": _limb("gripper_yaw_w_rad", 1e300),
    "fingers a metre apart": _limb("finger_separation_m", 1.0),
    "a force of a meganewton": _limb("finger_force_w_n", [1e6, 0.0, 0.0, -1e6, 0.0, 0.0]),
    "negative friction": _limb("friction", -1.0),
    "one air knot": _limb("phase", 1),
}


@pytest.mark.parametrize("change", BAD_PLANS.values(), ids=BAD_PLANS.keys())
def test_a_sound_upload_of_an_unsound_plan(target: Target, good: plan_t, change: Callable[[plan_t], None]) -> None:
    change(good)
    good.plan_id = plan_id(good)
    with pytest.raises(UsageError, match=r"refuses the plan: .+"):
        target.link.upload(good)
    target.assert_alive()


def test_a_plan_changed_after_checking(target: Target, good: plan_t) -> None:
    good.knots[0].body_position_w_m = [0.001, 0.0, 0.185]
    with pytest.raises(UsageError, match=r"refuses the plan: .+"):
        target.link.upload(good)
    target.assert_alive()


def test_after_all_that_a_good_plan_is_taken(target: Target, good: plan_t) -> None:
    assert target.link.upload(good).verdict == acknowledgement_t.ACCEPTED
    target.assert_alive()
