"""HOLD is answered, and nobody believes a lie, whatever a process without a key sends to runtime and operators."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import attacks
import pytest
from crux_msgs import acknowledgement_t, command_t
from crux_tools.cli import main
from crux_tools.known_runtimes import known_path
from crux_tools.operator_key import OperatorKey
from crux_tools.operator_link import OperatorLink
from own_runtime import Runtime, Starter

GROWN_KB = 40_000  # of the runtime's memory, at most: what waits for its turn is bounded
SETTLE_S = 0.3
HOLDS, MANY_HOLDS = 5, 100
WITHIN_S = 0.2


@dataclass
class Robots:
    """A runtime with keys, two operators, and a watcher."""

    runtime: Runtime
    folder: Path

    def key(self, who: str) -> Path:
        return self.folder / f"{who}.pem"

    def link(self, who: str = "ann") -> OperatorLink:
        """As `crux hold` makes one."""
        return OperatorLink(self.runtime.ports.lcm_url, first_request=time.time_ns(), key=self.key(who))

    def held(self, who: str = "ann") -> float:
        """Seconds until HOLD was answered."""
        with self.link(who) as link:
            began_s = time.monotonic()
            answer = link.command(command_t.HOLD)
            assert answer is not None
            assert answer.verdict == acknowledgement_t.ACCEPTED, answer.reason
            return time.monotonic() - began_s

    def memory_kb(self) -> int:
        lines = Path(f"/proc/{self.runtime.process.pid}/status").read_text(encoding="ascii").splitlines()
        return int(next(line for line in lines if line.startswith("VmRSS")).split()[1])


@pytest.fixture
def robots(start: Starter, tmp_path: Path) -> Robots:
    """Known to the operators, as after the first contact."""
    people = {"ann": "operate", "bob": "operate", "eve": "watch"}
    lines = [OperatorKey.new(tmp_path / f"{name}.pem").line(role, name) + "\n" for name, role in people.items()]
    keys = tmp_path / "keys"
    keys.write_text("".join(lines), encoding="ascii")
    identity = tmp_path / "runtime.pem"
    made = Robots(start("--keys", str(keys), "--identity", str(identity), pace="clock"), tmp_path)
    made.link().send(command_t.STATUS)
    return made


@contextmanager
def attacked(name: str, robots: Robots) -> Iterator[None]:
    """By a process of its own, which has heard the operator before."""
    command = [sys.executable, attacks.__file__, name, robots.runtime.ports.lcm_url]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        process.stdout.readline()  # it listens
        for who in ("ann", "eve"):
            robots.held(who)
        time.sleep(SETTLE_S)
        yield
        assert process.poll() is None, process.communicate()[1]
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("name", attacks.ATTACKS)
def test_hold_is_answered_under_every_attack(robots: Robots, name: str) -> None:
    before_kb = robots.memory_kb()
    with attacked(name, robots):
        for i in range(HOLDS):
            robots.held("eve" if i % 2 else "ann")
        ann = robots.link()
        told = ann.send(command_t.STATUS)
        assert told.supervisor_state == 0
        assert ann.status is not None
        assert ann.status.lease != 2**63 - 2
        assert robots.memory_kb() - before_kb < GROWN_KB
    assert robots.link().take_lease() is not None
    robots.link().send(command_t.SHUTDOWN)
    assert robots.runtime.end()[0] == 0


@pytest.mark.sweep
@pytest.mark.parametrize("name", attacks.ATTACKS)
def test_a_hundred_holds_of_a_hundred(robots: Robots, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with attacked(name, robots):
        took_s = sorted(robots.held("eve" if i % 2 else "ann") for i in range(MANY_HOLDS))
    with capsys.disabled():
        median_ms, most_ms = 1e3 * statistics.median(took_s), 1e3 * took_s[-1]
        print(f"\n{name}: HOLD answered after {median_ms:.1f} ms (median), {most_ms:.1f} ms at most")
    assert took_s[-1] < WITHIN_S


@pytest.mark.parametrize("name", ["garbage", "forged_answers"])
def test_the_commands_themselves_never_fail_by_what_they_hear(
    robots: Robots, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    url, key = robots.runtime.ports.lcm_url, str(robots.key("ann"))
    with attacked(name, robots):
        for words in (["hold", "--key", key], ["status"], ["speed", "1", "--key", key]):
            capsys.readouterr()
            status = main([*words, "--lcm", url, "--json"])
            told = json.loads(capsys.readouterr().out)
            assert "internal" not in str(told)
            assert (status, told["ok"]) == (0, True) or "not all nodes" in told["error"]


def test_a_runtime_with_another_key_is_not_believed(robots: Robots, start: Starter, tmp_path: Path) -> None:
    robots.runtime.process.kill()
    robots.runtime.process.wait()
    other = ("--keys", str(tmp_path / "keys"), "--identity", str(tmp_path / "other.pem"))
    with pytest.raises(Exception, match=r"not the one in .*runtimes:\d+"):
        start(*other, ports=robots.runtime.ports)
    with pytest.raises(Exception, match="HOLD was sent all the same"), robots.link() as link:
        link.command(command_t.HOLD)
    known_path().unlink()
    assert robots.link().send(command_t.STATUS).verdict == acknowledgement_t.ACCEPTED


def test_at_the_first_contact_two_that_say_they_are_the_runtime_are_told(
    robots: Robots, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crux_tools.operator_link.FIRST_CONTACT_S", 3.0)  # a busy machine answers late
    with attacked("forged_answers", robots):
        known_path().unlink()
        with pytest.raises(Exception, match="2 runtimes answer"), robots.link() as link:
            link.command(command_t.STATUS)
        assert not known_path().exists()
        robots.held()  # which needs to know nobody
