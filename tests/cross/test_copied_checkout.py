"""A checkout that was built and then copied builds itself, not the place it came from."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = """cmake_minimum_required(VERSION 3.25)
project(small NONE)
foreach(name crux_programs crux_native_tests)
  add_custom_target(${name} COMMAND ${CMAKE_COMMAND} -E copy ${CMAKE_SOURCE_DIR}/source ${CMAKE_BINARY_DIR}/built)
endforeach()
"""


def small_checkout(folder: Path) -> None:
    """The project's own Makefile over a CMake project that copies one file; nothing to install."""
    (folder / "tools" / "setup").mkdir(parents=True)
    shutil.copy(ROOT / "Makefile", folder)
    shutil.copy(ROOT / "tools" / "setup" / "configure", folder / "tools" / "setup")
    (folder / "CMakeLists.txt").write_text(PROJECT)
    for path in ("tools/setup/setup", ".venv/bin/python"):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).symlink_to("/bin/true")


def make(folder: Path, *targets: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    done = subprocess.run(
        ["make", *targets], cwd=folder, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("old_place", ["stays", "goes"])
def test_a_copy_builds_its_own_sources(old_place: str, tmp_path: Path) -> None:
    first, second = tmp_path / "my first", tmp_path / "my second"
    targets = ("programs", "configure-sanitized")
    small_checkout(first)
    (first / "source").write_text("first")
    make(first, *targets)
    configured = (first / "build" / "cmake" / "CMakeCache.txt").stat().st_mtime_ns
    make(first, *targets)
    assert (first / "build" / "cmake" / "CMakeCache.txt").stat().st_mtime_ns == configured  # what is in its place stays
    shutil.copytree(first, second, symlinks=True)
    (second / "source").write_text("second")
    if old_place == "goes":
        shutil.rmtree(first)
    make(second, *targets)
    subprocess.run(["cmake", "--build", "build/asan", "--target", "crux_native_tests"], cwd=second, check=True)
    assert [(second / "build" / kind / "built").read_text() for kind in ("cmake", "asan")] == ["second"] * 2
    if old_place == "stays":
        assert (first / "build" / "cmake" / "built").read_text() == "first"


def test_more_is_configured_when_it_is_asked_for_and_stays(tmp_path: Path) -> None:
    cache = tmp_path / "my checkout" / "build" / "cmake" / "CMakeCache.txt"
    small_checkout(tmp_path / "my checkout")
    (tmp_path / "my checkout" / "source").touch()
    make(tmp_path / "my checkout", "programs")
    assert "CRUX_TESTS" not in cache.read_text()
    make(tmp_path / "my checkout", "configure-development")
    assert re.search("^CRUX_TESTS:[A-Z]*=ON$", cache.read_text(), re.MULTILINE)
    configured = cache.stat().st_mtime_ns
    make(tmp_path / "my checkout", "programs", "configure-development")
    assert cache.stat().st_mtime_ns == configured


@pytest.mark.parametrize(("target", "levels"), [("climb", {"programs"}), ("test-native", {""}), ("docs", {"programs"})])
def test_a_target_sets_up_what_it_needs_and_no_more(target: str, levels: set[str]) -> None:
    done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=True)
    words = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("tools/setup/setup")]
    assert {" ".join(level) for level in words} == levels
