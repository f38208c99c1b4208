"""tools/setup/tidy.py looks again at a file that passed when, and only when, something that decides has changed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from crux_tools.paths import ROOT

BUILD = """rule cc
  command = cc -Iinclude -MD -MF $out.d -c $in -o $out
  deps = gcc
  depfile = $out.d
build a.o: cc a.c
build b.o: cc b.c
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Two sources, a header of the first, built; clang-tidy is a stand-in that notes whom it looked at."""
    (tmp_path / "include").mkdir()
    (tmp_path / "include" / "a.h").write_text("int a(void);\n")
    (tmp_path / "a.c").write_text('#include "a.h"\nint a(void) { return 1; }\n')
    (tmp_path / "b.c").write_text("int b(void);\nint b(void) { return 2; }\n")
    (tmp_path / "build.ninja").write_text(BUILD)
    (tmp_path / ".clang-tidy").write_text("Checks: '*'\n")
    entries = [
        {"directory": str(tmp_path), "file": str(tmp_path / f"{n}.c"), "command": f"cc -Iinclude -c {n}.c -o {n}.o"}
        for n in "ab"
    ]
    (tmp_path / "compile_commands.json").write_text(json.dumps(entries))
    (tmp_path / "bin").mkdir()
    tool = tmp_path / "bin" / "clang-tidy"
    tool.write_text('#!/bin/sh\n[ "$1" = --version ] && exit\nfor f; do :; done\necho $f >>seen\n! grep WRONG $f\n')
    tool.chmod(0o755)
    return tmp_path


def looked_at(project: Path) -> tuple[list[str], int]:
    """Builds, runs tidy.py; which files clang-tidy was called for, and the exit status."""
    (project / "seen").write_text("")
    env = os.environ | {"PATH": f"{project / 'bin'}:{os.environ['PATH']}", "XDG_CACHE_HOME": str(project / "cache")}
    subprocess.run(["ninja", "-C", project], check=True, capture_output=True)
    command = [sys.executable, str(ROOT / "tools" / "setup" / "tidy.py"), ".", "2", "a.c", "b.c"]
    status = subprocess.run(command, cwd=project, env=env, capture_output=True, check=False).returncode
    return sorted((project / "seen").read_text().split()), status


def test_only_what_changed_is_looked_at(project: Path) -> None:
    assert looked_at(project) == (["a.c", "b.c"], 0)
    assert looked_at(project) == ([], 0)
    os.utime(project / "a.c")
    assert looked_at(project) == ([], 0)
    (project / "include" / "a.h").write_text("int a(void); /* other */\n")
    assert looked_at(project) == (["a.c"], 0)
    (project / ".clang-tidy").write_text("Checks: 'bugprone-*'\n")
    assert looked_at(project) == (["a.c", "b.c"], 0)


def test_what_fails_is_looked_at_until_it_passes(project: Path) -> None:
    (project / "b.c").write_text("int b(void); /* WRONG */\n")
    assert looked_at(project) == (["a.c", "b.c"], 1)
    assert looked_at(project) == (["b.c"], 1)
    (project / "b.c").write_text("int b(void);\n")
    assert looked_at(project) == (["b.c"], 0)
