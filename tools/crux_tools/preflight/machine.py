"""What the kernel says of this machine: real time, processors, limits, clock, disk, heat."""

from __future__ import annotations

import os
import resource
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from crux_tools.priority import AWAKE

GOOD, DOUBTFUL, BAD = "good", "doubtful", "bad"
RUNTIME_PRIORITY = 80  # runtime/app/realtime.cpp
LOG_BYTES_A_S = 1.5e6  # of a log with all CAN frames at 500 Hz
LEAST_CLIMBS_S = 4 * 3600.0  # of logging that the disk must have room for
SYNC_BYTES = 1 << 20
SLOW_SYNC_S = 0.5
HOT_C = 80.0
CLOCK_UNSYNCHRONISED = 0x40  # STA_UNSYNC of adjtimex(2)


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    topic: str
    verdict: str  # GOOD, DOUBTFUL or BAD
    found: str
    remedy: str = ""  # what to do where it is not good


@dataclass(frozen=True)
class Kernel:
    """Its files: /proc and /sys below `root`."""

    root: Path = Path("/")

    def text(self, path: str) -> str | None:
        """Of one file, None where there is none or it cannot be read."""
        try:
            return (self.root / path).read_text(encoding="utf-8", errors="replace").strip()
        except OSError:
            return None

    def texts(self, pattern: str) -> list[str]:
        """Of all files that a pattern fits."""
        found = (self.text(str(path.relative_to(self.root))) for path in sorted(self.root.glob(pattern)))
        return [text for text in found if text]


def real_time_kernel(kernel: Kernel) -> Finding:
    """PREEMPT_RT, by its own flag or the kernel's version line."""
    if kernel.text("sys/kernel/realtime") == "1" or "PREEMPT_RT" in (kernel.text("proc/version") or ""):
        return Finding("kernel", GOOD, "real-time kernel (PREEMPT_RT)")
    remedy = "as root: apt-get install linux-image-rt-amd64 (linux-image-rt-arm64), then boot it"
    return Finding("kernel", DOUBTFUL, "no real-time kernel: interrupts and drivers may delay a cycle", remedy)


def isolated_processor(kernel: Kernel) -> Finding:
    """A processor that the scheduler gives to nobody."""
    isolated = kernel.text("sys/devices/system/cpu/isolated") or ""
    if isolated:
        return Finding("isolation", GOOD, f"processors {isolated} are kept free of other programs")
    remedy = "boot with isolcpus=3 nohz_full=3 rcu_nocbs=3, and set CPUAffinity=3 in crux-runtime.service"
    return Finding("isolation", DOUBTFUL, "no processor is kept free of other programs", remedy)


def processor_speed(kernel: Kernel) -> Finding:
    """No frequency governor that slows down between two cycles."""
    governors = set(kernel.texts("sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"))
    if not governors or governors == {"performance"}:
        return Finding("frequency", GOOD, "processors keep their frequency")
    found = f"frequency governor {', '.join(sorted(governors))}: a cycle after an idle one takes longer"
    return Finding("frequency", DOUBTFUL, found, "as root: cpupower frequency-set -g performance")


def real_time_share(kernel: Kernel) -> Finding:
    """Throttling of real-time threads stops the runtime for the rest of a period."""
    runtime_us = kernel.text("proc/sys/kernel/sched_rt_runtime_us")
    if runtime_us in (None, "-1"):
        return Finding("throttling", GOOD, "real-time threads are not throttled")
    period_us = kernel.text("proc/sys/kernel/sched_rt_period_us") or "1000000"
    share = int(runtime_us or 0) / int(period_us)
    found = f"real-time threads get {100 * share:.0f} % of a processor, enough for the runtime's 10 %"
    if share >= 0.5:
        return Finding("throttling", GOOD, found)
    remedy = "as root: sysctl kernel.sched_rt_runtime_us=950000"
    return Finding("throttling", BAD, f"real-time threads get {100 * share:.0f} % of a processor only", remedy)


def permissions() -> Finding:
    """May this user run at the runtime's priority, with its memory locked?"""
    if os.geteuid() == 0:
        return Finding("permissions", GOOD, "root may use real-time priority and lock memory")
    priority = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    missing = []
    if priority != resource.RLIM_INFINITY and priority < RUNTIME_PRIORITY:
        missing.append(f"real-time priority up to {priority}, the runtime uses {RUNTIME_PRIORITY}")
    if locked != resource.RLIM_INFINITY:
        missing.append(f"{locked // 1024} kB of locked memory, the runtime locks all of its own")
    if not missing:
        return Finding("permissions", GOOD, "this user may use real-time priority and lock memory")
    remedy = "start it by crux-runtime.service, or in /etc/security/limits.d: rtprio 80, memlock unlimited"
    return Finding("permissions", BAD, f"this user has {'; '.join(missing)}", remedy)


def sleep(device: Path = Path(AWAKE)) -> Finding:
    """May this user keep the processors from sleeping, as the runtime does while it goes by the clock?"""
    if os.access(device, os.W_OK):
        return Finding("sleep", GOOD, f"{device} may be written: no processor will take long to wake")
    why = "may not be written by this user" if device.exists() else "is missing"
    remedy = f"start it by crux-runtime.service, or as root: chgrp and chmod g+w {device} for the runtime's user"
    return Finding("sleep", DOUBTFUL, f"{device} {why}: a sleeping processor may wake a cycle late", remedy)


def clock() -> Finding:
    """Logs carry the time of day; it should be somebody else's, too."""
    import ctypes

    buffer = ctypes.create_string_buffer(512)  # struct timex, `modes` 0: read only
    status_at = 5 * ctypes.sizeof(ctypes.c_long)  # modes and its padding, offset, freq, maxerror, esterror
    if ctypes.CDLL(None, use_errno=True).adjtimex(buffer) < 0:
        return Finding("clock", DOUBTFUL, "the kernel does not say whether the clock is synchronised")
    status = int.from_bytes(buffer.raw[status_at : status_at + 4], "little")
    if not status & CLOCK_UNSYNCHRONISED:
        return Finding("clock", GOOD, "the time of day is synchronised")
    remedy = "as root: apt-get install systemd-timesyncd, or chrony"
    return Finding("clock", DOUBTFUL, "the time of day is not synchronised: logs will be dated wrong", remedy)


def disk(folder: Path) -> Finding:
    """Room for logs where they go, and how long a write takes to arrive."""
    there = next(path for path in (folder, *folder.resolve().parents) if path.exists())
    free = shutil.disk_usage(there).free
    hours = free / LOG_BYTES_A_S / 3600
    probe = there / f".crux-preflight-{os.getpid()}"
    try:
        with probe.open("wb") as stream:
            stream.write(os.urandom(SYNC_BYTES))
            begin_s = time.monotonic()
            os.fsync(stream.fileno())
            took_s = time.monotonic() - begin_s
    except OSError as error:
        return Finding("disk", BAD, f"{there} cannot be written: {error.strerror}", "name another folder by --logs")
    finally:
        probe.unlink(missing_ok=True)
    found = f"{free / 1e9:.1f} GB free in {there}, {hours:.0f} h of the fullest logs; 1 MB arrives in {took_s:.2f} s"
    if free < LEAST_CLIMBS_S * LOG_BYTES_A_S:
        return Finding("disk", BAD, found, "make room, or name another folder by --logs")
    if took_s > SLOW_SYNC_S:
        return Finding("disk", DOUBTFUL, found, "a faster disk; a log that lags has gaps, which are told")
    return Finding("disk", GOOD, found)


def heat(kernel: Kernel) -> Finding:
    """The hottest of the kernel's thermal zones."""
    zones_C = [int(text) / 1000 for text in kernel.texts("sys/class/thermal/thermal_zone*/temp") if _is_number(text)]
    if not zones_C:
        return Finding("heat", DOUBTFUL, "the kernel tells no temperature", "look at the board's own sensors")
    if max(zones_C) < HOT_C:
        return Finding("heat", GOOD, f"{max(zones_C):.0f} °C at most")
    return Finding("heat", BAD, f"{max(zones_C):.0f} °C: it will slow down", f"cool it below {HOT_C:.0f} °C")


def _is_number(text: str) -> bool:
    return text.lstrip("-").isdigit()


def of_machine(kernel: Kernel, logs: Path) -> Iterator[Finding]:
    """All of it, one after the other."""
    for look in (real_time_kernel, isolated_processor, processor_speed, real_time_share, heat):
        yield look(kernel)
    yield permissions()
    yield sleep()
    yield clock()
    yield disk(logs)
