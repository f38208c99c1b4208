"""A log's cycles computed again by the runtime's own control core, from what it was given, and compared bit by bit.

The core is a function of robot description, plans and inputs alone, all of which the log has (crux-recompute runs it
without clock, bus or LCM). So the first difference is where another build of the runtime decides otherwise. A build for
another processor rounds otherwise: there numbers may differ by a little, and nothing else may.
"""

from __future__ import annotations

import contextlib
import math
import struct
import subprocess
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from crux_contracts.channels import BY_TOPIC, SCHEMAS
from crux_contracts.robot import Robot

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import progress
from crux_tools.paths import built
from crux_tools.telemetry.cdr_table import decode_table, fixed_dtype
from crux_tools.telemetry.channels import Payloads, read_payloads
from crux_tools.telemetry.description import difference, robot_of
from crux_tools.telemetry.log_format import newer_format

T = TypeVar("T")
BINARY = "runtime/app/crux-recompute"
PLAN, RESTART, INPUT = "/plan", "/restart", "/control_input"
OUTPUTS = ("/control_output", "/robot_state")  # of a cycle, as crux-recompute writes them
KIND = {PLAN: 0, INPUT: 1, RESTART: 2}
TOPICS = {*KIND, *OUTPUTS}
BLOCK = 500  # messages that are given, cycles that are compared at once
_MOST_bytes = 1 << 16  # of one message
_RECORD, _LENGTH, _CYCLE = struct.Struct("<BI"), struct.Struct("<I"), struct.Struct("<4xq")


@dataclass(frozen=True)
class Difference:
    """The first number that came out otherwise."""

    cycle: int
    topic: str
    field: str  # with an index where it is an array
    logged: Any
    computed: Any

    def __str__(self) -> str:
        return (
            f"cycle {self.cycle}, {self.topic} {self.field}: {self.logged} in the log, {self.computed} computed again"
        )


@dataclass(frozen=True)
class Comparison:
    """`cycles` compared; `missing_cycle`: one the log has not, behind which nothing can be computed.

    `largest`: of the differences of numbers that were allowed, in the unit of whatever they are of.
    """

    cycles: int
    first_difference: Difference | None
    missing_cycle: int | None
    largest: float = 0.0

    @property
    def ok(self) -> bool:
        return self.first_difference is None and self.missing_cycle is None and self.cycles > 0

    def to_json(self) -> dict[str, Any]:
        """What `crux replay --check --json` prints."""
        first = None if self.first_difference is None else vars(self.first_difference)
        return vars(self) | {"ok": self.ok, "first_difference": first}


def recompute(path: Path, within: float = 0.0) -> Comparison:
    """As `recomputed`, of a file. Raises LogError besides."""
    return recomputed(read_payloads(path, TOPICS), path, lambda: None, within)[0]


def recomputed(
    log: Payloads, path: Path, beside: Callable[[], T], within: float, other_robot: Robot | None = None
) -> tuple[Comparison, T]:
    """`log` has what `path` has of TOPICS; besides what `beside` gives, which is called while the core computes.

    Numbers may differ by no more than `within` there. With `other_robot` the core computes by that description, in
    place of the log's own, and takes the log's plans.
    Raises UsageError where there is nothing to compute again, WorkFailed where the core refuses.
    """
    _refuse_others(log, path)
    given, cycles, missing_cycle = _given(log)
    switches = ["--calibrate"] if log.metadata.get("calibrates") == "yes" else []
    if other_robot is not None:
        switches += ["--as", log.metadata.get("robot_sha256", "")]
    logged = robot_of(log.metadata.get("robot", ""), log.attachments)
    with (
        logged if other_robot is None else contextlib.nullcontext(other_robot) as robot,
        tempfile.TemporaryFile() as errors,
        ThreadPoolExecutor(2) as threads,
        subprocess.Popen(
            [built(BINARY), robot.folder, *switches], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
        ) as core,
    ):
        assert core.stdin is not None
        assert core.stdout is not None
        feeding, found_beside = threads.submit(_feed, core.stdin, given), threads.submit(beside)
        try:
            found = _compare(log, core.stdout, cycles, missing_cycle, within)
        except EOFError as error:
            core.wait()
            errors.seek(0)
            raise WorkFailed(f"{path}: {errors.read().decode(errors='replace').strip()}") from error
        finally:
            core.kill()
            feeding.result()
        return found, found_beside.result()


def _refuse_others(log: Payloads, path: Path) -> None:
    """Raises UsageError for what is no log, or one of another robot or crux."""
    missing = [topic for topic in (INPUT, *OUTPUTS) if not log.payloads.get(topic)]
    if missing:
        raise UsageError(f"{path}: no {', '.join(missing)} in it: this is no log of crux-runtime")
    if not log.attachments and (differs := difference(log.metadata, {})):
        raise UsageError(f"{path}: {differs}")
    for topic in (INPUT, *OUTPUTS):
        if log.definitions[topic] != SCHEMAS[BY_TOPIC[topic].type].definition:
            commit = log.metadata.get("commit", "unknown")
            whose = f"{topic} is of another crux (commit {commit}), which alone can compute it again"
            raise UsageError(f"{path}: {newer_format(log.metadata) or whose}")
    if log.metadata.get("new_core") == "no":
        raise UsageError(
            f"{path}: begins in cycle {log.metadata.get('first_cycle')} of a run whose control core had worked before: "
            "what it knew by then stands in the log before, so this one cannot be computed again; it can be shown"
        )


def _feed(records: IO[bytes], given: list[tuple[str, bytes]]) -> None:
    """Gives the core what it got, as fast as it takes it."""
    with contextlib.suppress(BrokenPipeError), records:  # it has been ended: the first difference is found
        for first in range(0, len(given), BLOCK):
            block = given[first : first + BLOCK]
            records.write(b"".join(_RECORD.pack(KIND[topic], len(payload)) + payload for topic, payload in block))


def _given(log: Payloads) -> tuple[list[tuple[str, bytes]], list[int], int | None]:
    """What the core got, in that order, the cycles, and the first one that is missing."""
    before = [
        (time_ns, topic, payload)
        for topic in (PLAN, RESTART)
        for time_ns, payload in zip(log.times_ns.get(topic, []), log.payloads.get(topic, []), strict=True)
    ]
    before.sort(key=lambda message: message[0])  # a restart goes on with the plan of the same time
    given: list[tuple[str, bytes]] = []
    cycles: list[int] = []
    expected = int(log.metadata.get("first_cycle", "1"))
    for time_ns, payload in zip(log.times_ns[INPUT], log.payloads[INPUT], strict=True):
        (cycle,) = _CYCLE.unpack_from(payload)
        if cycle != expected:
            return given, cycles, expected
        expected += 1
        while before and before[0][0] <= time_ns:
            given.append(before.pop(0)[1:])
        given.append((INPUT, payload))
        cycles.append(cycle)
    return given, cycles, None


def _read(computed: IO[bytes], length: int) -> bytes:
    """Raises EOFError where the core has written less."""
    if len(found := computed.read(length)) < length:
        raise EOFError
    return found


def _compare(
    log: Payloads, computed: IO[bytes], cycles: list[int], missing_cycle: int | None, within: float
) -> Comparison:
    logged = [log.payloads[topic] for topic in OUTPUTS]
    largest = 0.0
    whole = min(len(cycles), *map(len, logged))  # the last cycle may be cut off
    same = (all(_CYCLE.unpack_from(each[row])[0] == cycles[row] for each in logged) for row in range(whole))
    if (other := next((row for row, is_same in enumerate(same) if not is_same), None)) is not None:
        whole, missing_cycle = other, cycles[other]
    with progress("computing again", whole) as bar:
        for first in range(0, whole, BLOCK):
            rows = range(first, min(first + BLOCK, whole))
            expected = [(row, i, _framed(logged[i][row])) for row in rows for i in range(len(OUTPUTS))]
            again = _read(computed, sum(len(message) for *_, message in expected))
            if again != b"".join(message for *_, message in expected):
                row, found, distance = _first_difference(log, cycles, expected, again, computed, within)
                if found is not None:
                    return Comparison(row + 1, found, missing_cycle)
                largest = max(largest, distance)
            bar.at(rows.stop)
    return Comparison(whole, None, missing_cycle, largest)


def _framed(message: bytes) -> bytes:
    """As crux-recompute writes it."""
    return _LENGTH.pack(len(message)) + message


def _first_difference(
    log: Payloads,
    cycles: list[int],
    expected: list[tuple[int, int, bytes]],
    again: bytes,
    computed: IO[bytes],
    within: float,
) -> tuple[int, Difference | None, float]:
    """In a block of messages of which at least one came out otherwise: its row, or else how far all are at most."""
    at, largest = 0, 0.0
    for row, i, message in expected:
        if again[at : at + len(message)] != message:
            (length,) = _LENGTH.unpack_from(again, at)
            if at + _LENGTH.size + length > len(again):
                again += computed.read(_MOST_bytes)
            old, new = message[_LENGTH.size :], again[at + _LENGTH.size : at + _LENGTH.size + length]
            distance = _distance(log, OUTPUTS[i], old, new) if within else math.inf
            if distance > within:
                return row, _difference(log, cycles[row], OUTPUTS[i], old, new, within), distance
            largest = max(largest, distance)
        at += len(message)
    return expected[-1][0], None, largest


def _distance(log: Payloads, topic: str, logged: bytes, computed: bytes) -> float:
    """The largest difference of two numbers; infinite where anything else is not the same."""
    dtype = fixed_dtype(log.definitions[topic])
    if dtype is None or len(logged) != len(computed):
        return math.inf
    old, new = decode_table([logged, computed], dtype)
    distances = [0.0]
    for name in dtype.names or ():
        if old[name].tobytes() != new[name].tobytes():
            real = old[name].dtype.kind == "f"
            distances.append(float(np.max(np.abs(old[name] - new[name]))) if real else math.inf)
    return math.inf if any(math.isnan(distance) for distance in distances) else max(distances)


def _difference(log: Payloads, cycle: int, topic: str, logged: bytes, computed: bytes, within: float) -> Difference:
    dtype = fixed_dtype(log.definitions[topic])
    if dtype is None or min(len(logged), len(computed)) < dtype.itemsize:
        return Difference(cycle, topic, "size", len(logged), len(computed))
    old, new = decode_table([logged, computed], dtype)
    for name in dtype.names or ():
        pairs = zip(old[name].reshape(-1), new[name].reshape(-1), strict=True)
        for index, (before, after) in enumerate(pairs):
            if before.tobytes() != after.tobytes() and not (before.dtype.kind == "f" and abs(before - after) <= within):
                field = f"{name}[{index}]" if old[name].ndim else name
                return Difference(cycle, topic, field, before.item(), after.item())
    return Difference(cycle, topic, "padding", "", "")
