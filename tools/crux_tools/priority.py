"""Programs that must not be late: neither other programs nor their own housekeeping may delay them."""

from __future__ import annotations

import contextlib
import gc
import os
import struct
from collections.abc import Iterator

PRIORITY = 10  # SCHED_FIFO, below the runtime's
AWAKE = "/dev/cpu_dma_latency"  # PM QoS: the time [us] a processor may take to wake, as long as the file is open


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
def realtime_priority(priority: int = PRIORITY) -> Iterator[bool]:
    """SCHED_FIFO and processors that wake at once for the time of a with-block; yields False where the system allows no
    SCHED_FIFO."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        yield False
        return
    with contextlib.ExitStack() as stack:
        stack.callback(os.sched_setscheduler, 0, os.SCHED_OTHER, os.sched_param(0))
        with contextlib.suppress(OSError):
            stack.enter_context(open(AWAKE, "wb", buffering=0)).write(struct.pack("i", 0))
        yield True
