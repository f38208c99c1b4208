"""`make lint` looks at the same files with and without a repository, and never passes for want of files."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = {"shellcheck": "SHELL_FILES", "clang-format": "CPP_FILES", "tidy.py": "TIDY_FILES"}


def recipe(tool: str) -> str:
    """The shell line of `make lint` that runs a tool."""
    shown = subprocess.run(["make", "-n", "lint"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (line,) = [line for line in shown.replace("\\\n", " ").splitlines() if f"{tool} " in line]
    return line


def shown_files(tool: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Runs that line in a folder, with `echo` for the tool."""
    line = re.sub(r"; [^;]*\$files$", "; echo $files", recipe(tool))
    return subprocess.run(["sh", "-c", line], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("tool", TOOLS)
def test_an_archive_of_the_sources_has_the_files_of_its_commit(tool: str, tmp_path: Path) -> None:
    archive = tmp_path / "my crux"
    archive.mkdir()
    packed = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x"], cwd=archive, input=packed, check=True)
    (archive / "build").mkdir()
    shutil.copy(ROOT / "msgs" / "can" / "e2e.c", archive / "build" / "made.c")  # a product is no source
    found = shown_files(tool, archive).stdout.split()
    tracked = subprocess.run(["git", "ls-files"], cwd=archive.parent, capture_output=True, check=False)
    assert tracked.returncode != 0  # no repository around it
    listed = subprocess.run(["git", "ls-tree", "-r", "--name-only", "HEAD"], cwd=ROOT, capture_output=True, check=True)
    names = listed.stdout.decode().splitlines()
    if tool == "shellcheck":
        expected = {name for name in names if re.match(b"#!/bin/(ba)?sh\n", (archive / name).read_bytes())}
    elif tool == "clang-format":
        expected = {name for name in names if name.endswith((".c", ".h", ".cpp", ".hpp"))}
    else:
        expected = {name for name in found if name.endswith((".c", ".cpp"))}
        assert {"msgs/can/e2e.c", "runtime/app/main.cpp", "firmware/core/joint_node.c"} <= expected
    assert len(expected) > 10
    assert set(found) == expected


@pytest.mark.parametrize("tool", TOOLS)
def test_no_file_is_a_failure(tool: str, tmp_path: Path) -> None:
    (tmp_path / "README").write_text("nothing to look at\n")
    done = shown_files(tool, tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    assert re.fullmatch(r"make lint: found no files .* below .*\n", done.stderr)
