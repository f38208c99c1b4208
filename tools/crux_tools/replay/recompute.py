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
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Queue
from typing import IO, Any, TypeVar

import numpy as np
from crux_contracts.channels import BY_TOPIC, SCHEMAS
from crux_contracts.robot import Robot

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import progress
from crux_tools.paths import built
from crux_tools.telemetry.cdr_table import decode_table, fixed_dtype
from crux_tools.telemetry.channels import Payloads, payload_blocks, read_payloads
from crux_tools.telemetry.description import difference, robot_of
from crux_tools.telemetry.log_format import newer_format

T = TypeVar("T")
Messages = list[tuple[str, bytes]]  # of topics
BINARY = "runtime/app/crux-recompute"
PLAN, RESTART, INPUT = "/plan", "/restart", "/control_input"
OUTPUTS = ("/control_output", "/robot_state")  # of a cycle, as crux-recompute writes them
KIND = {PLAN: 0, INPUT: 1, RESTART: 2}
TOPICS = {*KIND, *OUTPUTS}
BEHIND = 500  # cycles that the core has got when one is compared: more than it keeps before it writes
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

    `largest`: of the differences of numbers that were allowed, in the unit of whatever they are of. `lost`: what of the
    file could not be read, a sentence each.
    """

    cycles: int
    first_difference: Difference | None
    missing_cycle: int | None
    largest: float = 0.0
    lost: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        return self.first_difference is None and self.missing_cycle is None and self.cycles > 0

    def to_json(self) -> dict[str, Any]:
        """What `crux replay --check --json` prints."""
        first = None if self.first_difference is None else vars(self.first_difference)
        return vars(self) | {"ok": self.ok, "first_difference": first}


def recompute(path: Path, within: float = 0.0) -> Comparison:
    """As `recomputed`, of a file alone."""
    return recomputed(path, lambda: None, within)[0]


def recomputed(
    path: Path, beside: Callable[[], T], within: float, other_robot: Robot | None = None
) -> tuple[Comparison, T]:
    """Besides what `beside` gives, which is called while the core computes. The log is read a part after the other.

    Numbers may differ by no more than `within` there. With `other_robot` the core computes by that description, in
    place of the log's own, and takes the log's plans.
    Raises LogError, UsageError where there is nothing to compute again, WorkFailed where the core refuses.
    """
    log = read_payloads(path, TOPICS, {PLAN, RESTART})
    _refuse_others(log, path)
    switches = ["--calibrate"] if log.metadata.get("calibrates") == "yes" else []
    if other_robot is not None:
        switches += ["--as", log.metadata.get("robot_sha256", "")]
    logged = robot_of(log.metadata.get("robot", ""), log.attachments)
    given: Queue[Messages | None] = Queue()
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
            found = _Comparing(log, core.stdout, given, within).all_of(payload_blocks(path, {INPUT, *OUTPUTS}))
        except EOFError as error:
            core.wait()
            errors.seek(0)
            raise WorkFailed(f"{path}: {errors.read().decode(errors='replace').strip()}") from error
        finally:
            core.kill()
            given.put(None)
            feeding.result()
        if not found.cycles and found.missing_cycle is None and found.first_difference is None:
            _refuse_empty(path, (INPUT, *OUTPUTS), log.lost)
        return replace(found, lost=tuple(log.lost)), found_beside.result()


def _refuse_others(log: Payloads, path: Path) -> None:
    """Raises UsageError for what is no log, or one of another robot or crux."""
    if missing := [topic for topic in (INPUT, *OUTPUTS) if topic not in log.definitions]:
        _refuse_empty(path, missing, log.lost)
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


def _refuse_empty(path: Path, missing: Iterable[str], lost: Sequence[str]) -> None:
    raise UsageError(f"{path}: no {', '.join(missing)} in it: {'; '.join(lost) or 'this is no log of crux-runtime'}")


def _feed(records: IO[bytes], given: Queue[Messages | None]) -> None:
    """Gives the core what it got, as fast as it takes it, until there is None."""
    with contextlib.suppress(BrokenPipeError), records:  # it has been ended: the first difference is found
        while (block := given.get()) is not None:
            records.write(b"".join(_RECORD.pack(KIND[topic], len(payload)) + payload for topic, payload in block))


def _read(computed: IO[bytes], length: int) -> bytes:
    """Raises EOFError where the core has written less."""
    if len(found := computed.read(length)) < length:
        raise EOFError
    return found


class _Comparing:
    """The core's outputs against the log's, as the file is read: what is not compared yet is all that is kept."""

    def __init__(self, log: Payloads, computed: IO[bytes], given: Queue[Messages | None], within: float) -> None:
        self._log, self._computed, self._given, self._within = log, computed, given, within
        self._before = sorted(
            (
                (time_ns, topic, payload)
                for topic in (PLAN, RESTART)
                for time_ns, payload in zip(log.times_ns.get(topic, []), log.payloads.get(topic, []), strict=True)
            ),
            key=lambda message: message[0],  # a restart goes on with the plan of the same time
        )
        self._expected = int(log.metadata.get("first_cycle", "1"))  # next
        self._cycles: list[int] = []  # given to the core, not compared
        self._logged: tuple[list[bytes], ...] = tuple([] for _ in OUTPUTS)
        self._done, self._largest = 0, 0.0
        self._missing_cycle: int | None = None

    def all_of(self, blocks: Iterable[tuple[Payloads, float]]) -> Comparison:
        """Compares to the end of the log, or to the first difference, or to a cycle that the log has not."""
        with progress("computing again", 1.0) as bar:
            for block, share in blocks:
                self._take(block)
                ready = min(len(self._cycles), *map(len, self._logged))
                ends = share == 1.0 or (self._missing_cycle is not None and ready == len(self._cycles))
                if ends:
                    self._given.put(None)
                elif ready < 2 * BEHIND:
                    continue
                found = self._compare(ready if ends else ready - BEHIND)
                if ends or found is not None or self._missing_cycle is not None:
                    break
                bar.at(share)
        return Comparison(self._done, found, self._missing_cycle, self._largest)

    def _take(self, block: Payloads) -> None:
        """Gives the core the inputs of a block, and whatever came before each; keeps the outputs."""
        inputs = zip(block.times_ns.get(INPUT, []), block.payloads.get(INPUT, []), strict=True)
        given: Messages = []
        for time_ns, payload in inputs if self._missing_cycle is None else ():
            (cycle,) = _CYCLE.unpack_from(payload)
            if cycle != self._expected:
                self._missing_cycle = self._expected
                break
            self._expected += 1
            while self._before and self._before[0][0] <= time_ns:
                given.append(self._before.pop(0)[1:])
            given.append((INPUT, payload))
            self._cycles.append(cycle)
        self._given.put(given)
        for kept, topic in zip(self._logged, OUTPUTS, strict=True):
            kept.extend(block.payloads.get(topic, []))

    def _rest(self) -> bytes:
        """What the core has written besides; it gets nothing more."""
        self._given.put(None)
        return self._computed.read(_MOST_bytes)

    def _compare(self, ready: int) -> Difference | None:
        """The next cycles, up to one whose outputs the log has not."""
        cycles = self._cycles[:ready]
        has = [
            all(_CYCLE.unpack_from(each[row])[0] == cycle for each in self._logged) for row, cycle in enumerate(cycles)
        ]
        whole = has.index(False) if False in has else ready
        expected = [(row, i, _framed(self._logged[i][row])) for row in range(whole) for i in range(len(OUTPUTS))]
        again = _read(self._computed, sum(len(message) for *_, message in expected))
        if again != b"".join(message for *_, message in expected):
            row, found, distance = _first_difference(self._log, cycles, expected, again, self._rest, self._within)
            if found is not None:
                self._done += row + 1
                return found
            self._largest = max(self._largest, distance)
        self._done += whole
        if whole < ready:
            self._missing_cycle = cycles[whole]
        del self._cycles[:ready]
        for kept in self._logged:
            del kept[:ready]
        return None


def _framed(message: bytes) -> bytes:
    """As crux-recompute writes it."""
    return _LENGTH.pack(len(message)) + message


def _first_difference(
    log: Payloads,
    cycles: list[int],
    expected: list[tuple[int, int, bytes]],
    again: bytes,
    rest: Callable[[], bytes],
    within: float,
) -> tuple[int, Difference | None, float]:
    """In a block of messages of which at least one came out otherwise: its row, or else how far all are at most."""
    at, largest = 0, 0.0
    for row, i, message in expected:
        if again[at : at + len(message)] != message:
            (length,) = _LENGTH.unpack_from(again, at)
            if at + _LENGTH.size + length > len(again):
                again += rest()
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
