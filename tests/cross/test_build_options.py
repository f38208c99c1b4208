"""What CMake builds follows from what was asked for, whatever the machine has."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEVELOPMENT = {"CRUX_TESTS", "CRUX_FIRMWARE", "CRUX_EMULATED", "CRUX_CCACHE"}


def configure(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    words = [
        "cmake",
        "-S",
        str(ROOT),
        "-B",
        str(folder / "cmake"),
        "-G",
        "Ninja",
        "-DCMAKE_MESSAGE_LOG_LEVEL=ERROR",
        *options,
    ]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def targets(folder: Path) -> set[str]:
    words = ["ninja", "-C", str(folder / "cmake"), "-t", "targets", "all"]
    shown = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return {line.split(":")[0] for line in shown.splitlines()}


def compiles(folder: Path) -> str:
    """The commands by which ninja compiles."""
    files = (folder / "cmake" / "build.ninja", folder / "cmake" / "CMakeFiles" / "rules.ninja")
    return "".join(file.read_text(encoding="utf-8") for file in files)


def test_without_options_only_the_programs_are_built(tmp_path: Path) -> None:
    """This machine has GoogleTest, the cross-compiler, Unicorn and ccache, which development needs."""
    (tmp_path / "programs").mkdir()
    done = configure(tmp_path / "programs")
    assert done.returncode == 0, done.stderr
    found = targets(tmp_path / "programs")
    assert {
        "crux_programs",
        "crux-runtime",
        "crux-recompute",
        "libcrux_bound.so",
        "libcrux_chain.so",
        "libcrux_checker.so",
        "libcrux_path.so",
        "libcrux_reach.so",
        "libcrux_sim.so",
        "libcrux_stages.so",
        "libcrux_tape.so",
        "libcrux_nodes.so",
    } <= found
    assert not found & {"crux_images", "crux_firmware", "libcrux_emulated.so", "msgs_test", "core_tests"}
    assert "CCACHE_DEPEND" not in compiles(tmp_path / "programs")
    assert "-Werror" not in compiles(tmp_path / "programs")

    (tmp_path / "all").mkdir()
    done = configure(tmp_path / "all", *(f"-D{name}=ON" for name in DEVELOPMENT))
    assert done.returncode == 0, done.stderr
    assert {"crux_images", "crux_firmware", "libcrux_emulated.so", "msgs_test", "core_tests"} <= targets(
        tmp_path / "all"
    )
    assert "CCACHE_DEPEND" in compiles(tmp_path / "all")


@pytest.mark.parametrize(
    ("options", "package"),
    [
        (["-DCRUX_TESTS=ON", "-DCMAKE_DISABLE_FIND_PACKAGE_GTest=ON"], "libgtest-dev"),
        (["-DCRUX_TESTS=ON", "-DCMAKE_DISABLE_FIND_PACKAGE_nlohmann_json=ON"], "nlohmann-json3-dev"),
        (["-DCRUX_FIRMWARE=ON", "-DCRUX_ARM_GCC=/bin/echo"], "libnewlib-arm-none-eabi"),  # a compiler without newlib
    ],
)
def test_what_is_asked_for_and_missing_is_named(options: list[str], package: str, tmp_path: Path) -> None:
    done = configure(tmp_path, *options)
    said = " ".join(done.stderr.split())
    assert done.returncode == 1
    assert f"{options[0].removeprefix('-D')} needs" in said
    assert f"apt-get install {package};" in said


def test_make_build_asks_for_everything_and_make_programs_for_nothing() -> None:
    asked = {}
    for target in ("build", "programs"):
        shown = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        (line,) = [line for line in shown.splitlines() if line.startswith("tools/setup/configure build/cmake")]
        asked[target] = {word[2:].split("=")[0] for word in line.split() if word.endswith("=ON")}
    assert asked == {"build": DEVELOPMENT | {"CMAKE_COMPILE_WARNING_AS_ERROR"}, "programs": set()}
