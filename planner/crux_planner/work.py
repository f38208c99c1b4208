"""What a planner tells while it works, and how an attempt may fail."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from crux_planner.bound.beside import Beside

Progress = Callable[[str, float], None]
"""Called with what begins now and the share of the work behind, 0..1."""

Culprit = tuple[int, int] | None
"""The move (contact to contact) that a failed attempt should do without; None where no other sequence would help."""


@dataclass
class Work:
    """Says what is being done and keeps the time of each part."""

    report: Progress
    log: Callable[[str], None]
    began: float = field(default_factory=time.monotonic)
    seconds: dict[str, float] = field(default_factory=dict)
    bound: Beside | None = None

    @contextmanager
    def part(self, name: str, share: float) -> Iterator[None]:
        self.report(name, share)
        since = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(self.seconds.get(name, 0.0) + time.monotonic() - since, 3)

    def stop_bound(self) -> None:
        """No bound any more."""
        if self.bound is not None:
            self.bound.stop()
            self.bound = None
