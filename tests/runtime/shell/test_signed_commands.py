"""Only its operators command a robot: what others send is refused with its reason, logged, and the climb goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import lcm
import pytest
from crux_contracts import channels
from crux_msgs import acknowledgement_t, command_t, plan_piece_t, robot_state_t, signed_t, status_t
from crux_simulation.sim.ports import run_ports
from crux_tools.cli import main
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.operator_key import OperatorKey
from crux_tools.operator_link import OperatorLink
from own_runtime import Starter
from robot_on_wall import RobotOnWall
from test_operator import logged
from test_robot_on_wall import plan_along

ROLES = {"ann": "operate", "bob": "operate", "eve": "watch"}
REFUSALS_A_SECOND = 10  # that are logged
PATIENCE_S = 600.0  # the machine may be slow and busy


@dataclass
class Keys:
    """Of ann, bob, eve and one unknown, and the runtime's file that names the first three."""

    folder: Path

    def __post_init__(self) -> None:
        self.of = {name: OperatorKey.new(self.path(name)) for name in (*ROLES, "unknown")}
        self.file = self.folder / "keys"
        self.file.write_text("".join(self.of[name].line(role, name) + "\n" for name, role in ROLES.items()))

    def path(self, name: str) -> Path:
        return self.folder / f"{name}.pem"


@pytest.fixture
def keys(tmp_path: Path) -> Keys:
    return Keys(tmp_path)


def request_of(packet: bytes) -> int:
    """Of the command in it. Raises ValueError."""
    return int(command_t.decode(bytes(signed_t.decode(packet).data)).request_id)


def is_command(packet: bytes) -> bool:
    try:
        request_of(packet)
    except ValueError:
        return False
    return True


class Attacker:
    """Hears what is signed, and sends what he likes."""

    def __init__(self, url: str) -> None:
        self._link = OperatorLink(url, first_request=500_000)
        self.heard: list[bytes] = []
        self._ear = lcm.LCM(url)
        self._ear.subscribe(channels.CRUX_SIGNED, lambda _channel, data: self.heard.append(data))
        self._next_id = 1_000_000

    @property
    def commands(self) -> list[bytes]:
        """Those heard that are no pieces of plans, nor about the lease, nor HOLD."""
        while self._ear.handle_timeout(100):
            pass
        return [packet for packet in self.heard if is_command(packet)]

    @property
    def told(self) -> status_t:
        self._link.send(command_t.STATUS)
        assert self._link.status is not None
        return self._link.status

    def command(self, command: int, value: float = 0.0) -> command_t:
        self._next_id += 1
        message = command_t()
        message.request_id, message.command, message.value = self._next_id, command, value
        return message

    def refusal(self, channel: str, data: bytes, request_id: int) -> str:
        """Why the runtime does not do what it is sent."""
        self._link._answers.ask(channel, data)
        refused = acknowledgement_t.REFUSED  # what was replayed had been accepted before
        answer = self._link._await(lambda a: (a.request_id, a.verdict) == (request_id, refused), PATIENCE_S)
        assert answer is not None
        return str(answer.reason)


def ways_in(attacker: Attacker, keys: Keys) -> dict[str, str]:
    """The reasons that a runtime under ann's lease gives for all that he tries."""
    told = attacker.told
    replayed = attacker.commands[-1]

    def sealed(who: str, session: int = told.session, lease: int = told.lease, flip: int = 0) -> str:
        end = attacker.command(command_t.FORCE_SHUTDOWN)
        packet = bytearray(keys.of[who].sealed(session, time.time_ns(), lease, end.encode()))
        packet[-1] ^= flip
        return attacker.refusal(channels.CRUX_SIGNED, bytes(packet), end.request_id)

    unsigned = attacker.command(command_t.FORCE_SHUTDOWN)
    piece = plan_piece_t()
    piece.transfer_id, piece.n_pieces, piece.total_bytes, piece.n_bytes, piece.data = 4711, 1, 1, 1, b"x"
    return {
        "unsigned": attacker.refusal(channels.CRUX_COMMAND, unsigned.encode(), unsigned.request_id),
        "unsigned piece": attacker.refusal(channels.CRUX_PLAN_PIECE, piece.encode(), piece.transfer_id),
        "replayed": attacker.refusal(channels.CRUX_SIGNED, replayed, request_of(replayed)),
        "altered": sealed("ann", flip=1),
        "lease": sealed("ann", lease=told.lease ^ 1),
        "session": sealed("ann", session=told.session ^ 1),
        "role": sealed("eve"),
        "unknown": sealed("unknown"),
        "other operator": sealed("bob"),
    }


def until(met: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not met():
        assert time.monotonic() < end_s
        time.sleep(0.02)


WORDS = {
    "unsigned": "not signed",
    "unsigned piece": "not signed",
    "replayed": "replayed",
    "altered": "altered",
    "lease": "lease it was signed under has ended",
    "session": "another session",
    "role": "'eve' may watch",
    "unknown": "not among the keys",
    "other operator": "operator 'ann' has the lease",
}


def test_whatever_others_send_is_refused_and_logged_and_the_climb_goes_on(start: Starter, keys: Keys) -> None:
    plan = plan_along(0.0, 0.01, 0.02, 0.01)
    with run_ports() as ports, RobotOnWall(ports, plan) as robot:
        runtime = start("--guard-time", "30", "--keys", str(keys.file), ports=ports)
        url = ports.lcm_url
        attacker = Attacker(url)
        ann, bob = (OperatorLink(url, first, key=keys.path(who)) for first, who in ((1, "ann"), (1000, "bob")))
        ann.upload(plan)
        robot.await_state(robot_state_t.READY)
        ann.send(command_t.START, plan.plan_id)
        robot.await_state(robot_state_t.CLIMBING)
        ann.send(command_t.SPEED, value=0.02)  # so that the climb outlasts what is tried
        until(lambda: bool(attacker.told and attacker.commands))
        assert ann.take_lease() is not None
        reasons = ways_in(attacker, keys)
        assert {way: WORDS[way] in reason for way, reason in reasons.items()} == dict.fromkeys(WORDS, True), reasons
        assert attacker.told.state.supervisor_state == robot_state_t.CLIMBING
        assert bob.send(command_t.HOLD).supervisor_state == robot_state_t.HOLDING  # which is safe
        ann.send(command_t.SPEED, value=1.0)
        ann.send(command_t.RESUME)
        until(lambda: bool(attacker.told.state.plan_complete))
        ann.send(command_t.FORCE_SHUTDOWN)
        assert runtime.end()[0] == 0
    answers = [a for _, a in logged(runtime.log, "/acknowledgement")]
    refused = {a.reason for a in answers if a.verdict == acknowledgement_t.REFUSED}  # type: ignore[attr-defined]
    assert refused == set(reasons.values())
    assert "operator 'ann' has the lease" in {a.reason for a in answers}  # type: ignore[attr-defined]
    done = [c for _, c in logged(runtime.log, "/control_input")]
    given = {c.operator_command for c in done}  # type: ignore[attr-defined]
    assert command_t.FORCE_SHUTDOWN not in given


def test_a_flood_of_refusals_neither_fills_the_log_nor_keeps_an_operator_out(start: Starter, keys: Keys) -> None:
    runtime = start("--keys", str(keys.file))
    began_s = time.monotonic()
    sender = lcm.LCM(runtime.ports.lcm_url)
    message = command_t()
    message.command = command_t.FORCE_SHUTDOWN
    for number in range(500):
        message.request_id = number
        sender.publish(channels.CRUX_COMMAND, message.encode())
    ann = OperatorLink(runtime.ports.lcm_url, first_request=10_000, key=keys.path("ann"))
    assert ann.send(command_t.HOLD).reason == ""
    ann.send(command_t.SHUTDOWN)
    status, said = runtime.end()
    took_s = time.monotonic() - began_s
    assert status == 0
    assert "not signed" in said
    assert len(said.splitlines()) < 20
    unsigned = [c for _, c in logged(runtime.log, "/command") if c.command == command_t.FORCE_SHUTDOWN]  # type: ignore[attr-defined]
    assert REFUSALS_A_SECOND <= len(unsigned) <= REFUSALS_A_SECOND * (took_s + 1)


def test_operators_by_the_command_line(start: Starter, keys: Keys, capsys: pytest.CaptureFixture[str]) -> None:
    runtime = start("--keys", str(keys.file))

    def crux(*words: str, key: str = "") -> tuple[int, str]:
        capsys.readouterr()
        status = main([*words, "--lcm", runtime.ports.lcm_url, *(["--key", str(keys.path(key))] if key else [])])
        return status, "".join(capsys.readouterr())

    status, said = crux("hold", key="nobody")
    assert status == 2
    assert f"{keys.path('nobody')}: there is no key; `crux key new` makes one" in said
    assert crux("hold", key="unknown")[0] == 1
    assert crux("hold", key="bob") == (0, "runtime: idle, no plan\n")
    status, said = crux("status")
    assert status == 0
    assert "commands it" not in said
    assert "INSECURE" not in said
    assert "not all nodes" in crux("resume", key="ann")[1]
    assert "ann commands it, for " in crux("status")[1]
    status, said = crux("resume", key="bob")
    assert status == 1
    assert "operator 'ann' has the lease" in said
    assert crux("hold", key="bob")[0] == 0
    assert crux("hold", key="eve")[0] == 0
    assert "'eve' may watch, not operate" in crux("resume", key="eve")[1]
    assert crux("shutdown", key="ann")[0] == 0
    assert runtime.end()[0] == 0


def test_an_operator_goes_on_with_a_runtime_that_was_started_anew(start: Starter, keys: Keys) -> None:
    """What he signs for the session that has ended is refused, and signed anew."""
    first = start("--keys", str(keys.file))
    ann = OperatorLink(first.ports.lcm_url, first_request=10_000, key=keys.path("ann"))
    ann.upload(plan_along(0.0, 0.01))
    first.process.kill()
    first.process.wait()
    second = start("--keys", str(keys.file), ports=first.ports)
    ann.upload(plan_along(0.0, 0.01))
    ann.send(command_t.HOLD)
    ann.send(command_t.SHUTDOWN)
    assert second.end()[0] == 0


def test_two_links_with_one_key_share_its_lease_and_a_clock_set_back_is_no_harm(
    start: Starter, keys: Keys, monkeypatch: pytest.MonkeyPatch
) -> None:
    runtime = start("--keys", str(keys.file))
    links = [OperatorLink(runtime.ports.lcm_url, first, key=keys.path("ann")) for first in (10_000, 20_000)]
    plans = [plan_along(0.0, 0.01), plan_along(0.0, 0.02)]
    for link, plan in zip(links, plans, strict=True):
        assert link.upload(plan).plan_id == plan.plan_id
    monkeypatch.setattr(time, "time_ns", lambda: 1)
    for _ in range(2):
        for link in links:
            assert link.send(command_t.HOLD).reason == ""
    with pytest.raises((UsageError, WorkFailed), match="not all nodes"):
        links[0].send(command_t.RESUME)
    links[1].send(command_t.SHUTDOWN)
    assert runtime.end()[0] == 0
