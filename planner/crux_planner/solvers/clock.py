"""The clock that time limits go by: seconds of computing, not of the wall clock.

A machine that is busy with other things gives a planner fewer of them a second, but does not change what it finds in so
many of them.
"""

import time

from crux_planner.solvers.worker import ENDED_S, LIVE


def now() -> float:
    """Seconds [s] that this process and its workers, also those that have ended, have computed.

    Not what other children of this process have: one of a caller's that ends while it plans takes no time from it.
    """
    return time.process_time() + sum(computed_s(worker) for worker in LIVE) + sum(ENDED_S)


def computed_s(pid: int | None) -> float:
    """Seconds [s] that a process has computed, 0 where there is none (any more)."""
    if pid is None:
        return 0.0
    try:
        return time.clock_gettime(~pid << 3 | 2)  # Linux: what clock_getcpuclockid(3) gives for a process
    except OSError:
        return 0.0
