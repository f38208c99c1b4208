"""A log too long to be read whole: some moments of all of it, and every cycle of the seconds that are looked at."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from crux_tools.errors import UsageError
from crux_tools.telemetry import telemetry_of
from crux_tools.telemetry.part import read_part
from crux_tools.view.recording import Recording, recording_of_log

LONG_S = 600.0
CHUNKS, ROWS = 1200, 5  # of the whole; a chunk is what the runtime flushes at once, some 0.4 s
FINE_S = 20.0  # a range that is shorter is shown with every cycle
BLOCK_S = 10.0


class LongLog:
    """A source of the viewer. Raises LogError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        channels = read_part(path, -math.inf, math.inf, CHUNKS, ROWS)
        whole = recording_of_log(telemetry_of(path, channels), channels)
        if whole is None:
            raise UsageError(f"{path}: no plan was accepted in this log, so there is no wall to show")
        self.whole = whole
        self._fine: dict[tuple[float, float], Recording] = {}

    def between(self, from_s: float, to_s: float) -> Recording:
        """With every cycle where the range is short."""
        if to_s - from_s > FINE_S:
            return self.whole
        block = math.floor(from_s / BLOCK_S) * BLOCK_S, math.ceil(to_s / BLOCK_S) * BLOCK_S
        if block not in self._fine:
            channels = read_part(self._path, *block, chunks=10**6, rows=10**6)
            log = replace(telemetry_of(self._path, channels), plan=self.whole.log.plan)
            fine = recording_of_log(log, channels)
            assert fine is not None
            self._fine = {block: replace(fine, events=self.whole.events)}
        return self._fine[block]
