"""A log's cycles computed again by the runtime's own control core, from what it was given, and compared bit by bit.

The core is a function of robot description, plans and inputs alone, all of which the log has (crux-recompute runs it
without clock, bus or LCM). So the first difference is where another build of the runtime decides otherwise.
"""

from __future__ import annotations

import struct
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from crux_contracts.channels import BY_TOPIC, SCHEMAS

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import progress
from crux_tools.paths import built
from crux_tools.telemetry.cdr_table import decode_table, fixed_dtype
from crux_tools.telemetry.description import difference, robot_of
from crux_tools.telemetry.log_format import newer_format
from crux_tools.telemetry.reader import Payloads, read_payloads

BINARY = "runtime/app/crux-recompute"
PLAN, INPUT = "/plan", "/control_input"
OUTPUTS = ("/control_output", "/robot_state")  # of a cycle, as crux-recompute writes them
KIND = {PLAN: 0, INPUT: 1}
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
    """`cycles` compared; `missing_cycle`: one the log has not, behind which nothing can be computed."""

    cycles: int
    first_difference: Difference | None
    missing_cycle: int | None

    @property
    def ok(self) -> bool:
        return self.first_difference is None and self.missing_cycle is None and self.cycles > 0

    def to_json(self) -> dict[str, Any]:
        """What `crux replay --check --json` prints."""
        first = None if self.first_difference is None else vars(self.first_difference)
        return {"ok": self.ok, "cycles": self.cycles, "first_difference": first, "missing_cycle": self.missing_cycle}


def recompute(path: Path) -> Comparison:
    """Raises LogError or UsageError where there is nothing to compute again, WorkFailed where the core refuses."""
    log = read_payloads(path, {PLAN, INPUT, *OUTPUTS})
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
    given, cycles, missing_cycle = _given(log)
    switches = ["--calibrate"] if log.metadata.get("calibrates") == "yes" else []
    described = robot_of(log.metadata.get("robot", ""), log.attachments)
    with described as robot, tempfile.TemporaryFile() as records, tempfile.TemporaryFile() as errors:
        for topic, payload in given:
            records.write(_RECORD.pack(KIND[topic], len(payload)))
            records.write(payload)
        records.seek(0)
        with subprocess.Popen(
            [built(BINARY), robot.folder, *switches], stdin=records, stdout=subprocess.PIPE, stderr=errors
        ) as core:
            assert core.stdout is not None
            try:
                return _compare(log, _messages(core.stdout), cycles, missing_cycle)
            except EOFError as error:
                core.wait()
                errors.seek(0)
                raise WorkFailed(f"{path}: {errors.read().decode(errors='replace').strip()}") from error
            finally:
                core.kill()


def _given(log: Payloads) -> tuple[list[tuple[str, bytes]], list[int], int | None]:
    """Plans and inputs in the order in which the core got them, the cycles, and the first one that is missing."""
    plans = list(zip(log.times_ns.get(PLAN, []), log.payloads.get(PLAN, []), strict=True))
    given: list[tuple[str, bytes]] = []
    cycles: list[int] = []
    for time_ns, payload in zip(log.times_ns[INPUT], log.payloads[INPUT], strict=True):
        (cycle,) = _CYCLE.unpack_from(payload)
        if cycle != len(cycles) + 1:
            return given, cycles, len(cycles) + 1
        while plans and plans[0][0] <= time_ns:
            given.append((PLAN, plans.pop(0)[1]))
        given.append((INPUT, payload))
        cycles.append(cycle)
    return given, cycles, None


def _messages(computed: IO[bytes]) -> Iterator[bytes]:
    """What the core writes, one after the other. Raises EOFError where it ends."""
    while len(head := computed.read(_LENGTH.size)) == _LENGTH.size:
        (length,) = _LENGTH.unpack(head)
        message = computed.read(length)
        if len(message) < length:
            break
        yield message
    raise EOFError


def _compare(log: Payloads, computed: Iterator[bytes], cycles: list[int], missing_cycle: int | None) -> Comparison:
    whole = min(len(cycles), *(len(log.payloads[topic]) for topic in OUTPUTS))  # the last cycle may be cut off
    with progress("computing again", whole) as bar:
        for index in range(whole):
            for topic in OUTPUTS:
                again, logged = next(computed), log.payloads[topic][index]
                if _CYCLE.unpack_from(logged)[0] != cycles[index]:
                    return Comparison(index, None, cycles[index])
                if again != logged:
                    return Comparison(index + 1, _difference(log, cycles[index], topic, logged, again), missing_cycle)
            bar.at(index + 1)
    return Comparison(whole, None, missing_cycle)


def _difference(log: Payloads, cycle: int, topic: str, logged: bytes, computed: bytes) -> Difference:
    dtype = fixed_dtype(log.definitions[topic])
    if dtype is None or min(len(logged), len(computed)) < dtype.itemsize:
        return Difference(cycle, topic, "size", len(logged), len(computed))
    old, new = decode_table([logged, computed], dtype)
    for name in dtype.names or ():
        pairs = zip(old[name].reshape(-1), new[name].reshape(-1), strict=True)
        for index, (before, after) in enumerate(pairs):
            if before.tobytes() != after.tobytes():
                field = f"{name}[{index}]" if old[name].ndim else name
                return Difference(cycle, topic, field, before.item(), after.item())
    return Difference(cycle, topic, "padding", "", "")
