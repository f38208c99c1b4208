"""Scheduled faults: what a file may say, what rogue hosts put on a bus, and what is done to the runtime's process."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from crux_contracts import can_codec
from crux_contracts.yaml_document import DocumentError
from crux_simulation.sim.disturbance import Disturbance
from crux_simulation.sim.fault_file import FOR_GOOD, KINDS, OF_THE_RUNTIME, ON_SOCKETCAN, Fault, read_faults
from crux_simulation.sim.process_faults import ProcessFaults, check_process_faults
from crux_simulation.sim.rogue_hosts import SENDERS
from crux_simulation.sim.world_file import read_world
from crux_tools.errors import UsageError
from crux_tools.paths import WORLDS

DT_S = 0.002
ROOT = Path(__file__).parents[2]


def written(folder: Path, text: str) -> Path:
    path = folder / "faults.yaml"
    path.write_text(text)
    return path


def test_files_of_faults_and_worlds_on_the_page_are_there_and_can_be_read() -> None:
    page = (ROOT / "docs" / "worlds.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| `[a-z0-9-]+`.*$", page.partition("| file | what the runtime does |")[2].partition("\n\n")[0], re.M
    )
    names = [name for row in rows for name in re.findall(r"`([a-z0-9][a-z0-9-]+)`", row.split("|")[1])]
    faults = {path.stem: read_faults(path) for path in (ROOT / "tools" / "faults").glob("*.yaml")}
    worlds = {path.stem: read_world(path) for path in WORLDS.glob("*.yaml")}
    assert len(names) > 10
    assert set(faults) <= set(names)
    assert set(names) <= set(faults) | set(worlds)


def test_faults_are_read_and_sorted_by_time(tmp_path: Path) -> None:
    lines = []
    for n, kind in enumerate(KINDS):
        limb = "" if kind in OF_THE_RUNTIME else ", limb: RR"
        lasts = "" if kind in FOR_GOOD else ", for_s: 0.5"
        lines.append(f"  - {{kind: {kind}{limb}, at_s: {20 - n * 0.5}{lasts}}}")
    faults = read_faults(written(tmp_path, "version: 1\nfaults:\n" + "\n".join(lines) + "\n"))
    assert [fault.kind for fault in faults] == list(reversed(KINDS))
    assert {fault.limb for fault in faults if fault.kind not in OF_THE_RUNTIME} == {3}
    assert {fault.limb for fault in faults if fault.kind in OF_THE_RUNTIME} == {-1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("version: 2\nfaults: []\n", "version"),
        ("version: 1\n", "faults"),
        ("version: 1\nfaults:\n  - {kind: cat, limb: RF, at_s: 1, for_s: 1}\n", "cut"),
        ("version: 1\nfaults:\n  - {kind: cut, limb: XX, at_s: 1, for_s: 1}\n", "limb"),
        ("version: 1\nfaults:\n  - {kind: cut, limb: RF, at_s: -1, for_s: 1}\n", "at_s"),
        ("version: 1\nfaults:\n  - {kind: cut, limb: RF, at_s: 1}\n", "for_s"),
        ("version: 1\nfaults:\n  - {kind: reset, limb: RF, node: 9, at_s: 1, for_s: 1}\n", "node"),
        ("version: 1\nfaults:\n  - {kind: loss, limb: RF, share: 30, at_s: 1, for_s: 1}\n", "share"),
        ("version: 1\nfaults:\n  - {kind: cut, at_s: 1, for_s: 1}\n", "limb"),
        ("version: 1\nfaults:\n  - {kind: runtime_killed, limb: RF, at_s: 1}\n", "limb"),
        ("version: 1\nfaults:\n  - {kind: runtime_stopped, at_s: 1}\n", "for_s"),
        ("version: 1\nfaults:\n  - {kind: power_lost, node: 3, at_s: 1}\n", "limb"),
        ("version: 1\nfaults:\n  - {kind: power_lost, at_s: 1, motors: stiff}\n", "braked"),
        ("version: 1\nfaults:\n  - {kind: disk_full, at_s: 1, share: 0.5}\n", "share"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(DocumentError) as error:
        read_faults(path)
    assert said in str(error.value)
    assert str(path) in str(error.value)


class Recorded:
    """Notes what is done to the nodes."""

    def __init__(self) -> None:
        self.calls: list[tuple[object, ...]] = []
        self.host = 2
        self.nodes = bytes([2] * 28)

    def __getattr__(self, name: str) -> object:
        return lambda *words: self.calls.append((name, *words))

    def host_state(self) -> int:
        return self.host

    def states(self) -> tuple[bytes, bytes, bytes, bytes]:
        return self.nodes[:24], bytes(24), self.nodes[24:], bytes(4)


def test_a_cut_lasts_from_its_beginning_to_its_end_and_is_timed() -> None:
    nodes = Recorded()
    disturbance = Disturbance([Fault("cut", 1, at_s=0.02, for_s=0.1)], nodes, DT_S, None, seed=0)  # type: ignore[arg-type]
    for cycle in range(100):
        disturbance.begin_cycle(cycle)
        nodes.host = 4 if cycle >= 21 else 2  # FAULT
        nodes.nodes = bytes([3] * 28) if 21 <= cycle < 25 else bytes([1] * 28) if cycle >= 25 else bytes([2] * 28)
        disturbance.end_cycle(cycle)
        assert (("lose", 1, 1.0, 1) in nodes.calls) == (cycle >= 10)
        assert (("lose", 1, 0.0, 1) in nodes.calls) == (cycle >= 60)
    (course,) = disturbance.courses
    assert course.runtime_s == pytest.approx(22 * DT_S - 0.02)
    assert course.held_s == pytest.approx(26 * DT_S - 0.02)
    assert not course.moved_on
    nodes.host = 2
    disturbance.end_cycle(100)
    assert course.moved_on


def test_power_is_lost_by_all_nodes_by_a_limb_s_or_by_one_for_a_while_or_for_good(tmp_path: Path) -> None:
    entries = (
        "at_s: 0.02, for_s: 0.1",
        "limb: RR, at_s: 0.04, motors: free",
        "limb: RF, node: 3, at_s: 0.06, for_s: 1",
    )
    lines = "".join(f"  - {{kind: power_lost, {entry}}}\n" for entry in entries)
    nodes = Recorded()
    faults = read_faults(written(tmp_path, f"version: 1\nfaults:\n{lines}"))
    disturbance = Disturbance(faults, nodes, DT_S, None, seed=0)  # type: ignore[arg-type]
    every = {(limb, node) for limb in range(4) for node in range(1, 9)}
    done = []
    for cycle in range(100):
        disturbance.begin_cycle(cycle)
        done += [(cycle, supply, {call[1:3] for call in nodes.calls if call[3] == supply}) for supply in range(3)]
        nodes.calls.clear()
    of_rr = {(3, node) for node in range(1, 9)}
    assert [call for call in done if call[2]] == [(10, 1, every), (20, 2, of_rr), (30, 1, {(1, 3)}), (60, 0, every)]
    assert disturbance.courses[1].as_json()["for_s"] is None
    assert not disturbance.over(600)
    assert disturbance.over(round((1.06 + 4) / DT_S)), "what lasts for good is watched as long as others"


def test_faults_of_interfaces_need_interfaces() -> None:
    for kind in ON_SOCKETCAN:
        with pytest.raises(UsageError, match="--bus socketcan"):
            Disturbance([Fault(kind, 0, 1.0, 1.0)], Recorded(), DT_S, None, 0)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", sorted(SENDERS))
def test_rogue_hosts_frames_are_whole_but_for_damaged_ones(kind: str) -> None:
    for cycle in (0, 100, 70000):
        frames = list(SENDERS[kind](cycle))
        assert len(frames) >= 6
        verdicts = {can_codec.check(frame, can_codec.Receiver()) for frame in frames}
        assert verdicts == {can_codec.Verdict.CORRUPT if kind == "crc" else can_codec.Verdict.OK}


@pytest.mark.parametrize(("node", "broadcast"), [(2, False), (7, False), (7, True)])
def test_a_second_board_answers_in_the_name_of_one_node(node: int, broadcast: bool) -> None:
    nodes = Recorded()
    fault = Fault("node_twice", 1, at_s=0.02, for_s=0.1, node=node)
    disturbance = Disturbance([fault], nodes, DT_S, None, 0, None, broadcast)  # type: ignore[arg-type]
    for cycle in range(100):
        disturbance.begin_cycle(cycle)
    answers = {2: ["JointStatus"], 7: ["GripperAnswer"] if broadcast else ["GripperStatus", "ForceTorque"]}[node]
    assert len(nodes.calls) == 50 * len(answers)
    for name, limb, identifier, data in nodes.calls:
        assert (name, limb) == ("intrude", 1)
        decoded = can_codec.decode(can_codec.Frame(identifier, data))  # type: ignore[arg-type]
        assert (decoded.name in answers, decoded.node) == (True, node)


class MadeUpRuntime:
    """A process that there is not."""

    pid = 1 << 30
    lcm_url = "udpm://239.255.76.67:19999?ttl=0"  # below all of the tests
    alive = True

    def is_alive(self) -> bool:
        return self.alive


def test_a_starved_runtime_has_its_share_at_the_beginning_of_each_period(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[tuple[int, int]] = []
    cycle = 0
    monkeypatch.setattr("crux_simulation.sim.process_faults.os.kill", lambda _pid, number: sent.append((cycle, number)))
    process = ProcessFaults(MadeUpRuntime(), tmp_path / "log")  # type: ignore[arg-type]
    fault = Fault("cpu_starved", -1, at_s=0.02, for_s=0.25, share=0.3)
    disturbance = Disturbance([fault], Recorded(), DT_S, None, 0, process)  # type: ignore[arg-type]
    for cycle in range(200):
        disturbance.begin_cycle(cycle)
    stop, go = signal.SIGSTOP, signal.SIGCONT
    assert sent == [(25, stop), (60, go), (75, stop), (110, go), (125, stop), (135, go)]


def test_a_runtime_that_is_stopped_goes_on_when_the_climb_is_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[int] = []
    monkeypatch.setattr("crux_simulation.sim.process_faults.os.kill", lambda _pid, number: sent.append(number))
    runtime = MadeUpRuntime()
    with ProcessFaults(runtime, tmp_path / "log") as process:  # type: ignore[arg-type]
        process.switch(Fault("runtime_stopped", -1, 1.0, 9.0), True)
        assert sent == [signal.SIGSTOP]
    assert sent == [signal.SIGSTOP, signal.SIGCONT]
    runtime.alive = False
    process.switch(Fault("runtime_killed", -1, 1.0), True)
    assert len(sent) == 2, "its number may be another's by now"


def test_faults_of_the_runtime_need_a_process_and_some_the_clock() -> None:
    for kind in OF_THE_RUNTIME:
        with pytest.raises(UsageError, match=f"'{kind}' needs a runtime of its own: --bus udp"):
            check_process_faults([Fault(kind, -1, 1.0, 1.0)], "memory", "lockstep")
        check_process_faults([Fault(kind, -1, 1.0, 1.0)], "udp", "realtime")
    for kind in ("runtime_stopped", "cpu_starved"):
        with pytest.raises(UsageError, match=f"'{kind}': in lockstep .* --pace realtime"):
            check_process_faults([Fault(kind, -1, 1.0, 1.0)], "udp", "lockstep")
