"""How late a program at the runtime's priority is woken, and how many LCM messages arrive."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable

import numpy as np

from crux_tools.errors import UsageError
from crux_tools.lcm_socket import NO_NETWORK, LcmSocket
from crux_tools.preflight.machine import BAD, DOUBTFUL, GOOD, RUNTIME_PRIORITY, Finding
from crux_tools.priority import realtime_priority

EDGES_US = np.array([0, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, np.inf])
LATE_SHARE = 0.25  # of a period: a cycle that begins so late may miss its end
MESSAGES, MESSAGE_BYTES, BURST = 2000, 1000, 20
CHANNEL = "CRUX_PREFLIGHT"


def woken_late_us(
    seconds: float, period_s: float, progress: Callable[[float], None] = lambda _done: None
) -> tuple[np.ndarray, bool]:
    """[µs] of each wake-up after its instant, and whether it was at real-time priority. Of a Python program: the
    runtime's own is no more."""
    count = max(1, round(seconds / period_s))
    late_us = np.zeros(count)
    with realtime_priority(RUNTIME_PRIORITY) as is_real_time:
        due_s = time.monotonic() + period_s
        for i in range(count):
            time.sleep(max(0.0, due_s - time.monotonic()))
            now_s = time.monotonic()
            late_us[i] = 1e6 * (now_s - due_s)
            due_s = max(due_s + period_s, now_s)
            if i % 250 == 0:
                progress(i * period_s)
    return late_us, is_real_time


def histogram(late_us: np.ndarray) -> list[tuple[str, int]]:
    """Bins that are not empty: "20 to 50 µs" and how many."""
    counts, _ = np.histogram(np.maximum(late_us, 0.0), EDGES_US)
    names = [f"{low:g} to {high:g} µs" for low, high in itertools.pairwise(EDGES_US[:-1])]
    names.append(f"more than {EDGES_US[-2]:g} µs")
    return [(name, int(count)) for name, count in zip(names, counts, strict=True) if count]


def lateness(late_us: np.ndarray, is_real_time: bool, period_s: float) -> Finding:
    """Judged by the worst wake-up against the period."""
    limit_us = 1e6 * LATE_SHARE * period_s
    p999_us = np.percentile(late_us, 99.9)
    found = f"woken {np.median(late_us):.0f} µs late, p99.9 {p999_us:.0f} µs, at most {late_us.max():.0f} µs"
    if not is_real_time:
        found += ", without real-time priority"
    if late_us.max() <= limit_us:
        return Finding("lateness", GOOD, found)
    remedy = f"stop other programs, fix the points above; required: {limit_us:.0f} µs, a quarter of a cycle"
    return Finding("lateness", BAD if p999_us > limit_us else DOUBTFUL, found, remedy)


def lcm_loss(url: str) -> Finding:
    """Messages to oneself by the operators' address, in bursts as an upload sends them."""
    arrived: set[bytes] = set()
    sent = [number.to_bytes(4, "little") + bytes(MESSAGE_BYTES) for number in range(MESSAGES)]

    def hear(timeout_s: float) -> None:
        while (
            len(arrived) < MESSAGES and (heard := link.receive(timeout_s, lambda to, _data: to == CHANNEL)) is not None
        ):
            arrived.add(heard[1])

    try:
        with LcmSocket(url) as link:
            for number, message in enumerate(sent, start=1):
                link.publish(CHANNEL, message)
                if number % BURST == 0:
                    hear(0.001)
            hear(0.2)
    except UsageError as error:
        return Finding("LCM", BAD, str(error), NO_NETWORK)
    arrived.intersection_update(sent)
    lost = MESSAGES - len(arrived)
    if lost == 0:
        return Finding("LCM", GOOD, f"{MESSAGES} messages, none lost")
    remedy = f"{NO_NETWORK}; more room: sysctl net.core.rmem_max=8388608 net.core.rmem_default=8388608"
    return Finding("LCM", BAD if lost == MESSAGES else DOUBTFUL, f"{lost} of {MESSAGES} messages lost", remedy)
