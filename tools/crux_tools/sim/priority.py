"""The bench plays the hardware: in real time neither other programs nor its own housekeeping may make it late."""

from __future__ import annotations

import contextlib
import gc
import os
from collections.abc import Iterator

PRIORITY = 10  # SCHED_FIFO, below the runtime's


@contextlib.contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Collecting garbage takes longer than a control cycle."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@contextlib.contextmanager
def realtime_priority() -> Iterator[bool]:
    """SCHED_FIFO for the time of a with-block; yields False where the system does not allow it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
