"""Plans and commands over LCM, good and hostile, and what a killed runtime leaves behind."""

from __future__ import annotations

import hashlib
import itertools
import random
import signal
from pathlib import Path

import pytest
from crux_contracts import channels
from crux_msgs import acknowledgement_t, command_t, plan_piece_t, plan_t, robot_state_t
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.operator_link import OperatorLink
from fake_nodes import FakeNodes
from hand_plan import standing_plan
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from own_runtime import Runtime, Starter, rerun_recovered
from rosbags.highlevel import AnyReader

_transfers = itertools.count(1)


def pieces_of(data: bytes, plan_id: str, size: int = plan_piece_t.MAX_BYTES) -> list[plan_piece_t]:
    """An upload, cut by hand."""
    transfer = next(_transfers)
    parts = [data[i : i + size] for i in range(0, len(data), size)]
    pieces = []
    for index, part in enumerate(parts):
        piece = plan_piece_t()
        piece.transfer_id = transfer
        piece.plan_id = plan_id
        piece.bytes_sha256 = hashlib.sha256(data).hexdigest()
        piece.total_bytes, piece.n_pieces, piece.piece = len(data), len(parts), index
        piece.n_bytes, piece.data = len(part), part
        pieces.append(piece)
    return pieces


def send(link: OperatorLink, pieces: list[plan_piece_t]) -> acknowledgement_t:
    """Sends pieces without waiting for theirs, and returns the verdict on the plan."""
    for piece in pieces:
        link._answers.ask(channels.CRUX_PLAN_PIECE, piece.encode())
    transfer = pieces[0].transfer_id
    verdict = link._await(lambda a: a.subject == acknowledgement_t.PLAN and a.request_id == transfer, 600.0)
    assert verdict is not None
    return verdict


def status(link: OperatorLink) -> acknowledgement_t:
    answer = link.send(command_t.STATUS)
    assert answer.verdict == acknowledgement_t.ACCEPTED
    return answer


def logged(log: Path, topic: str) -> list[tuple[int, object]]:
    """(log time, message) of a topic."""
    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(m.log_time, d) for _, _, m, d in reader.iter_decoded_messages(topics=[topic])]


@pytest.fixture(scope="module")
def plan() -> plan_t:
    return standing_plan()


def test_a_good_plan_is_taken_whatever_the_order_of_its_pieces(start: Starter, plan: plan_t) -> None:
    runtime = start()
    assert status(runtime.link).plan_id == ""
    pieces = pieces_of(plan.encode(), plan.plan_id, size=700)
    shuffled = pieces + pieces[:2]
    random.Random(1).shuffle(shuffled)
    verdict = send(runtime.link, shuffled)
    assert (verdict.verdict, verdict.reason) == (acknowledgement_t.ACCEPTED, "")
    assert status(runtime.link).plan_id == plan.plan_id
    runtime.link.send(command_t.SHUTDOWN)
    assert runtime.end() == (0, "")
    ((time_ns, on_log),) = logged(runtime.log, "/plan")
    assert time_ns == 0
    assert on_log.plan_id == plan.plan_id  # type: ignore[attr-defined]
    assert len(on_log.knots) == plan.n_knots  # type: ignore[attr-defined]


def test_a_plan_of_another_robot_is_refused_with_the_reason(start: Starter) -> None:
    runtime = start()
    for change in ("robot_name", "robot_sha256"):
        other = standing_plan()
        setattr(other, change, "0" * 64)
        other.plan_id = ""
        other.plan_id = hashlib.sha256(other.encode()).hexdigest()
        with pytest.raises((UsageError, WorkFailed), match="robot"):
            runtime.link.upload(other)
        assert status(runtime.link).plan_id == ""


def test_a_plan_damaged_on_the_way_is_refused_and_can_be_sent_again(start: Starter, plan: plan_t) -> None:
    runtime = start()
    pieces = pieces_of(plan.encode(), plan.plan_id, size=1000)
    whole = pieces[1].data
    pieces[1].data = whole[:10] + bytes([whole[10] ^ 1]) + whole[11:]
    verdict = send(runtime.link, pieces)
    assert verdict.verdict == acknowledgement_t.REFUSED
    assert "damaged on the way" in verdict.reason
    assert send(runtime.link, pieces_of(plan.encode(), plan.plan_id)).reason == ""


def test_bit_flipped_and_truncated_plans_leave_the_runtime_unharmed(start: Starter, plan: plan_t) -> None:
    runtime = start()
    data = plan.encode()
    chooser = random.Random(2)
    for trial in range(60):
        bad = bytearray(data)
        if trial % 3 == 0:
            bad = bad[: chooser.randrange(1, len(bad))]
        for _ in range(chooser.randrange(1, 5) if trial % 3 else 0):
            at = chooser.randrange(len(bad)) if trial % 2 else chooser.randrange(min(400, len(bad)))
            bad[at] ^= 1 << chooser.randrange(8)
        verdict = send(runtime.link, pieces_of(bytes(bad), plan.plan_id))
        assert verdict.verdict == acknowledgement_t.REFUSED
        assert verdict.reason
    assert status(runtime.link).plan_id == ""
    assert send(runtime.link, pieces_of(data, plan.plan_id)).reason == ""


def test_hostile_pieces_and_noise_leave_the_runtime_unharmed(start: Starter, plan: plan_t) -> None:
    runtime = start()
    chooser = random.Random(3)
    good = pieces_of(plan.encode(), plan.plan_id)[0].encode()
    for _ in range(300):
        bad = bytearray(good[: chooser.randrange(1, 300)] if chooser.random() < 0.3 else good)
        for _ in range(chooser.randrange(1, 6)):
            bad[chooser.randrange(min(len(bad), 200))] = chooser.randrange(256)
        runtime.link._answers.ask(channels.CRUX_PLAN_PIECE, bytes(bad))
        runtime.link._answers.ask(channels.CRUX_COMMAND, chooser.randbytes(chooser.randrange(60)))
    huge = pieces_of(plan.encode(), plan.plan_id)[0]
    huge.total_bytes, huge.n_pieces = 2**31 - 1, 2**31 - 1
    with pytest.raises((UsageError, WorkFailed), match="total_bytes"):
        runtime.link._send_piece(huge)
    status(runtime.link)
    resident_kB = int((Path("/proc") / str(runtime.process.pid) / "statm").read_text().split()[1]) * 4
    assert resident_kB < 150_000


def test_start_says_what_is_missing(start: Starter, plan: plan_t) -> None:
    runtime = start()

    def refusal(plan_id: str = "", at_cycle: int = 0) -> str:
        answer = runtime.link.command(command_t.START, plan_id, at_cycle)
        assert answer is not None
        assert answer.verdict == acknowledgement_t.REFUSED
        return str(answer.reason)

    assert "no plan" in refusal()
    runtime.link.upload(plan)
    assert "'other'" in refusal(plan_id="other")
    assert "nodes" in refusal(plan_id=plan.plan_id)
    assert "at_cycle" in refusal(plan_id=plan.plan_id, at_cycle=-1)


def test_a_scheduled_start_is_carried_out_in_its_cycle(start: Starter, plan: plan_t) -> None:
    """The nodes stand nowhere near the plan's start: the core refuses, in the cycle and nowhere else."""
    runtime = start("--guard-time", "30")
    runtime.link.upload(plan)
    granted = runtime.link.send(command_t.START, plan.plan_id, at_cycle=30)
    with FakeNodes(runtime.ports.bus_urls(), 60) as nodes:
        assert nodes.done.wait(600)
        request = granted.request_id
        second = runtime.link._await(lambda a: a.request_id == request, 600.0)
        assert second is not None
        assert second.verdict == acknowledgement_t.REFUSED
        assert second.reason
        runtime.link.send(command_t.SHUTDOWN)
        assert runtime.end()[0] == 0
    commands = [(t, c.command) for t, c in logged(runtime.log, "/command")]  # type: ignore[attr-defined]
    assert commands == [(30 * 2_000_000, command_t.START), (60 * 2_000_000, command_t.SHUTDOWN)]
    inputs = [i for _, i in logged(runtime.log, "/control_input")]
    assert [i.cycle for i in inputs if i.operator_command == command_t.START] == [30]  # type: ignore[attr-defined]
    verdicts = [(t, a.subject, a.verdict) for t, a in logged(runtime.log, "/acknowledgement")]  # type: ignore[attr-defined]
    assert verdicts[0] == (0, acknowledgement_t.PLAN, acknowledgement_t.ACCEPTED)
    assert verdicts[1] == (30 * 2_000_000, acknowledgement_t.COMMAND, acknowledgement_t.REFUSED)


def test_a_repeated_command_is_carried_out_once(start: Starter) -> None:
    runtime = start("--guard-time", "30")
    message = command_t()
    message.request_id, message.command = 77, command_t.CLEAR_FAULT
    with FakeNodes(runtime.ports.bus_urls(), 300) as nodes:
        nodes.await_cycle(10)
        for _ in range(3):
            runtime.link._answers.ask(channels.CRUX_COMMAND, message.encode())
            answer = runtime.link._await(lambda a: a.request_id == 77, 600.0)
            assert answer is not None
            assert answer.verdict == acknowledgement_t.ACCEPTED
        assert nodes.done.wait(600)
        runtime.link.send(command_t.SHUTDOWN)
        assert runtime.end()[0] == 0
    inputs = [i.operator_command for _, i in logged(runtime.log, "/control_input")]  # type: ignore[attr-defined]
    assert inputs.count(command_t.CLEAR_FAULT) == 1


def test_status_before_and_after_the_nodes_answer(start: Starter) -> None:
    runtime = start("--guard-time", "30")
    assert status(runtime.link).supervisor_state == robot_state_t.IDLE
    with FakeNodes(runtime.ports.bus_urls(), 40) as nodes:
        assert nodes.done.wait(600)
        status(runtime.link)
        runtime.link.send(command_t.SHUTDOWN)
        assert runtime.end()[0] == 0
    commands = [c.command for _, c in logged(runtime.log, "/command")]  # type: ignore[attr-defined]
    assert commands == [command_t.SHUTDOWN]  # questions leave no trace


def kill_in_mid_run(runtime: Runtime, cycles: int) -> None:
    with FakeNodes(runtime.ports.bus_urls(), 100_000) as nodes:
        nodes.await_cycle(cycles)
        runtime.process.send_signal(signal.SIGKILL)
        runtime.end()


def test_the_log_of_a_killed_runtime_opens_everywhere(start: Starter, plan: plan_t) -> None:
    runtime = start()
    runtime.link.upload(plan)
    kill_in_mid_run(runtime, 400)
    with runtime.log.open("rb") as file:
        assert [m.name for m in make_reader(file).iter_metadata()] == ["crux", "crux_plan"]  # and no "crux_end"
    cycles = [s.cycle for _, s in logged(runtime.log, "/robot_state")]  # type: ignore[attr-defined]
    assert cycles == list(range(1, len(cycles) + 1))
    assert len(cycles) > 50
    with AnyReader([runtime.log]) as reader:
        connections = [c for c in reader.connections if c.topic == "/control_output"]
        assert len(list(reader.messages(connections))) == len(cycles)
    assert "/limb_telemetry" in rerun_recovered(runtime.log)
