"""`crux log lcm`: what is heard over real LCM is what is in the log, and nothing that commands or answers."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import crux_msgs
import lcm
import pytest
from crux_contracts.channels import BY_NAME
from crux_msgs import robot_state_t
from crux_simulation.sim.ports import run_ports
from crux_tools.cli import main
from crux_tools.log import lcm_command
from crux_tools.telemetry import read_log
from made_up_climb import Story, made_up_plan, write_log


@pytest.fixture
def url() -> Iterator[str]:
    with run_ports() as ports:
        yield ports.lcm_url


class Listener:
    """Everything that is sent to an address, by channel."""

    def __init__(self, url: str) -> None:
        self.heard: dict[str, list[bytes]] = defaultdict(list)
        self._lcm = lcm.LCM(url)
        self._lcm.subscribe(".*", lambda channel, data: self.heard[channel].append(data)).set_queue_capacity(0)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while self._lcm.handle_timeout(200) > 0 or not self._ended.is_set():
            pass

    def __enter__(self) -> Listener:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def test_what_is_played_is_what_is_in_the_log(url: str, log_path: Path) -> None:
    log = read_log(log_path)
    words = ["--speed", "1e6", "--from", "0.5", "--to", "0.6"]  # few: the kernel drops what is not fetched
    with Listener(url) as listener:
        assert main(["log", "lcm", str(log_path), *words, "--lcm", url]) == 0
    states = [robot_state_t.decode(data) for data in listener.heard["CRUX_ROBOT_STATE"]]
    rows = range(50, 61, 2)  # 100 Hz in the log, 50 at most on LCM
    assert [state.cycle for state in states] == [log.state["cycle"][row] for row in rows]
    for state, row in zip(states, rows, strict=True):
        assert list(state.body_position_w_m) == log.state["body_position_w_m"][row].tolist()
        assert state.speed_scale == 0  # not in the made-up log
    limbs = [crux_msgs.limb_telemetry_t.decode(data) for data in listener.heard["CRUX_LIMB_TELEMETRY"]]
    assert [limb.limb for limb in limbs] == [0, 1, 2, 3] * len(rows)
    assert [limb.grasp_force_n for limb in limbs[2::4]] == [log.limbs["grasp_force_n"][row, 2] for row in rows]
    heard = {channel for channel in listener.heard if channel.startswith("CRUX_")}  # LCM tests itself, too
    assert {BY_NAME[channel].writer for channel in heard} == {"runtime"}
    assert "CRUX_ACKNOWLEDGEMENT" not in heard


def test_a_plan_is_played_whole(url: str, log_path: Path) -> None:
    with Listener(url) as listener:
        assert main(["log", "lcm", str(log_path), "--speed", "1e6", "--to", "0.1", "--lcm", url]) == 0
    (heard,) = listener.heard["CRUX_PLAN"]
    assert heard == made_up_plan().encode()


def test_it_keeps_time(monkeypatch: pytest.MonkeyPatch, log_path: Path) -> None:
    now, sent = [0.0], []
    monkeypatch.setattr("crux_tools.log.lcm_command.time.monotonic", lambda: now[0])
    monkeypatch.setattr("crux_tools.log.lcm_command.time.sleep", lambda wait_s: now.__setitem__(0, now[0] + wait_s))
    found = lcm_command.messages(log_path, 1.0, 2.0)
    lcm_command.play(found, lambda channel, _: sent.append((now[0], channel)), 2.0, lambda _: None)
    for (sent_s, channel), message in zip(sent, found, strict=True):
        assert channel == message.channel
        assert sent_s == pytest.approx((message.time_ns / 1e9 - 1.0) / 2)
    assert now[0] == pytest.approx(0.5)


def test_it_does_not_mix_with_a_runtime(url: str, log_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link, ended = lcm.LCM(url), threading.Event()

    def talk() -> None:
        while not ended.wait(0.01):
            link.publish("CRUX_ROBOT_STATE", robot_state_t().encode())

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        assert main(["log", "lcm", str(log_path), "--lcm", url]) == 2
    finally:
        ended.set()
        thread.join()
    assert "a runtime talks there" in capsys.readouterr().err


def test_wrong_input_is_one_line(log_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, named in (
        ([str(log_path), "--from", "90"], "nothing to play in it from 90 to inf s"),
        ([str(tmp_path)], "is a folder"),
        ([str(log_path), "--lcm", "nonsense"], "cannot open LCM at nonsense"),
    ):
        assert main(["log", "lcm", *words]) == 2
        assert named in capsys.readouterr().err
    short = tmp_path / "short.mcap"
    write_log(short, Story(ready_cycles=3, wait_cycles=0))
    with pytest.raises(SystemExit):
        main(["log", "lcm", str(short), "--speed", "0"])
    assert "expected a number above 0" in capsys.readouterr().err
