"""Our user-mode Linux: built once from Debian's kernel source, kept in the user's cache.

Two things no packaged one has: virtual time, and CAN, netem and multicast built in. One correction to the source:
its room for a task's vector registers ends before those of newer processors, which then refuse to restore them.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from crux_tools.output import note, progress

from crux_can_kernel.job import NoKernel

SOURCE_PACKAGE = "linux-source-6.1"
SOURCE = Path(f"/usr/src/{SOURCE_PACKAGE}.tar.xz")
CONFIG = Path(__file__).with_name("uml_kernel.config")
TOOLS = {
    "make": "make",
    "gcc": "gcc",
    "flex": "flex",
    "bison": "bison",
    "bc": "bc",
    "xz": "xz-utils",
    "strip": "binutils",
}
MUST_HAVE = ("CAN_RAW", "CAN_VCAN", "CAN_ISOTP", "HOSTFS", "IP_MULTICAST", "NET_SCH_NETEM", "UML_TIME_TRAVEL_SUPPORT")
CORRECTED_FILE = "arch/x86/um/user-offsets.c"
REGISTERS_WRONG, REGISTERS_RIGHT = "DEFINE_LONGS(HOST_FP_SIZE, 2696);", "DEFINE_LONGS(HOST_FP_SIZE, 12288);"
STEPS = 960  # lines that make prints; for the progress bar alone
NOTE_EVERY_S = 60.0
KEPT = 2  # kernels in the cache; the oldest go


def cache() -> Path:
    """~/.cache/crux/kernels, or below $XDG_CACHE_HOME."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "crux" / "kernels"


def _version() -> str:
    """Of the installed source package; raises NoKernel."""
    try:
        shown = subprocess.run(
            ["dpkg-query", "-W", "-f", "${Version}", SOURCE_PACKAGE], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        raise NoKernel("not a Debian system: there is no dpkg-query") from None
    if shown.returncode != 0 or not SOURCE.exists():
        raise NoKernel(f"its source is not installed (as root: apt-get install {SOURCE_PACKAGE})")
    return shown.stdout.strip()


def kernel_path() -> Path:
    """Where the kernel for this source and configuration is or will be. Raises NoKernel."""
    recipe = CONFIG.read_bytes() + f"{CORRECTED_FILE}{REGISTERS_RIGHT}".encode()
    version = re.sub(r"[^\w.+-]", "_", _version())
    return cache() / f"uml-{version}-{hashlib.sha256(recipe).hexdigest()[:12]}"


def kernel() -> Path:
    """The kernel's executable; built when it is missing, which takes minutes. Raises NoKernel."""
    path = kernel_path()
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with _alone(path.parent / "lock"):
        if not path.exists():
            _build(path)
    return path


@contextlib.contextmanager
def _alone(lock: Path) -> Iterator[None]:
    with lock.open("w") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            note("crux can: another run is building the kernel; waiting for it")
            fcntl.flock(held, fcntl.LOCK_EX)
        yield


def _build(path: Path) -> None:
    missing = sorted({package for tool, package in TOOLS.items() if shutil.which(tool) is None})
    if missing:
        raise NoKernel(f"tools to build it are missing (as root: apt-get install {' '.join(missing)})")
    note("crux can: building the user-mode kernel; once, about 3 minutes of two quiet processors")
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="build-", dir=path.parent) as folder:
        root = Path(folder)
        _call(["tar", "-xf", str(SOURCE), "-C", str(root), "--strip-components=1"], root)
        _correct(root / CORRECTED_FILE)
        _call(["make", "-s", "ARCH=um", f"KCONFIG_ALLCONFIG={CONFIG}", "allnoconfig"], root)
        _check_config((root / ".config").read_text())
        _make(root)
        _call(["strip", "-o", "stripped", "linux"], root)
        (root / "stripped").replace(path)
    kept = sorted(path.parent.glob("uml-*"), key=lambda file: file.stat().st_mtime)
    for old in kept[:-KEPT]:
        old.unlink(missing_ok=True)
    note(f"crux can: built {path} in {(time.monotonic() - began_s) / 60:.1f} min")


def _correct(file: Path) -> None:
    text = file.read_text()
    if text.count(REGISTERS_WRONG) != 1:
        raise NoKernel(f"{SOURCE}: {CORRECTED_FILE} does not read '{REGISTERS_WRONG}' once: another kernel version?")
    file.write_text(text.replace(REGISTERS_WRONG, REGISTERS_RIGHT))


def _check_config(config: str) -> None:
    lacking = [option for option in MUST_HAVE if f"CONFIG_{option}=y" not in config.splitlines()]
    if lacking:
        raise NoKernel(f"{CONFIG.name}: the kernel source does not grant {', '.join(lacking)}")


def _call(arguments: list[str], folder: Path) -> None:
    done = subprocess.run(arguments, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode != 0:
        raise NoKernel(f"{arguments[0]} failed: {_end_of(done.stdout.decode(errors='replace'))}")


def _end_of(text: str, lines: int = 12) -> str:
    return "\n".join(text.strip().splitlines()[-lines:])


def _make(root: Path) -> None:
    """make with a progress bar, or a line a minute where there is no terminal.

    Without the compiler cache, which would only slow down what is built once: the kernel itself is kept.
    """
    jobs = len(os.sched_getaffinity(0))
    log = root / "make.log"
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["make", "ARCH=um", "CC=gcc", f"-j{jobs}", "linux"], cwd=root, stdout=output, stderr=subprocess.STDOUT
        )
        began_s = noted_s = time.monotonic()
        try:
            with progress("building the user-mode kernel", STEPS) as bar:
                while process.poll() is None:
                    time.sleep(0.5)
                    steps = log.read_bytes().count(b"\n")
                    bar.at(min(steps, STEPS))
                    if time.monotonic() - noted_s > NOTE_EVERY_S:
                        noted_s = time.monotonic()
                        note(f"crux can: step {steps} of about {STEPS}, {noted_s - began_s:.0f} s")
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    if process.returncode != 0:
        raise NoKernel(f"make failed: {_end_of(log.read_text(errors='replace'))}")
