"""Firmware compiled apart from the usual build, with flags of a test's own: for coverage, mutants and fuzzing."""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from shutil import which

from crux_tools.paths import BUILD_DIR, ROOT, built

GENERATED_C = ROOT / "build" / "gen" / "c"
MONOCYPHER = ROOT / ".venv" / "share" / "pymonocypher"
INCLUDES = [
    *(
        f"-I{ROOT / folder}"
        for folder in (
            "firmware/core",
            "firmware/safety",
            "firmware/service",
            "firmware/update",
            "firmware/ports/host",
            "msgs/can",
            "tests/firmware",
        )
    ),
    f"-isystem{GENERATED_C}",
    f"-isystem{MONOCYPHER}",
]
SAFETY_SOURCES = (ROOT / "firmware/safety/safety.c", ROOT / "firmware/safety/permission.c", ROOT / "msgs/can/e2e.c")
CORE_SOURCES = (*sorted((ROOT / "firmware/core").glob("*.c")), GENERATED_C / "crux_can.c")
SERVICE_SOURCES = (
    *sorted((ROOT / "firmware/service").glob("*.c")),
    *sorted((ROOT / "firmware/update").glob("*.c")),
    ROOT / "firmware/ports/host/flash_model.c",
    GENERATED_C / "crux_parameters.c",
)
SIGNATURE_SOURCES = (MONOCYPHER / "monocypher.c",)
SAFETY_LIBRARY = "libcrux_safety_room.so"
JOBS = 2


class CompileError(Exception):
    """What the compiler said."""


def compiler(source: Path, family: str) -> list[str]:
    """The compiler of a source, through the compiler cache where there is one."""
    c = source.suffix == ".c"
    name = {"gcc": ("gcc", "g++"), "clang": ("clang", "clang++")}[family][0 if c else 1]
    cache = ["ccache"] if which("ccache") else []
    return [*cache, name, "-std=c11" if c else "-std=c++20"]


def run(command: Sequence[str], folder: Path) -> None:
    """Runs a compiler or linker; raises CompileError with its words."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise CompileError(f"{' '.join(map(str, command))}\n{done.stderr}")


def objects(sources: Iterable[Path], folder: Path, flags: Sequence[str], family: str = "gcc") -> list[Path]:
    """Compiles each source to folder/NAME.o and returns the objects."""
    folder.mkdir(parents=True, exist_ok=True)

    def one(source: Path) -> Path:
        target = folder / f"{source.stem}.o"
        command = [
            *compiler(source, family),
            *flags,
            *INCLUDES,
            "-ffp-contract=off",
            "-c",
            str(source),
            "-o",
            target.name,
        ]
        run(command, folder)
        return target

    with ThreadPoolExecutor(JOBS) as pool:
        return list(pool.map(one, sources))


def safety_tests(folder: Path, *options: str, limit_s: float | None = None) -> subprocess.CompletedProcess[str]:
    """The tests of the safety room, run with the room's library that lies in `folder`."""
    return subprocess.run(
        [str(built("tests/firmware/safety_tests")), *options],
        env={"LD_LIBRARY_PATH": str(folder)},
        capture_output=True,
        text=True,
        errors="replace",
        timeout=limit_s,
        check=False,
    )


def build_folder(name: str) -> Path:
    """A folder of its own below the build folder."""
    return BUILD_DIR.parent / "firmware-checks" / name
