"""The safety room is executed whole by its tests: every line, both ways of every branch."""

from __future__ import annotations

import gzip
import json
import subprocess
from typing import Any

import native
import pytest


@pytest.fixture(scope="module")
def coverage() -> list[dict[str, Any]]:
    """What gcov counted in each file of the safety room while its tests ran."""
    folder = native.build_folder("coverage")
    for old in folder.glob("*.gc*"):
        old.unlink()
    # -O0 without inlining: the branches counted are those of the source.
    safety = native.objects(native.SAFETY_SOURCES, folder, ["-O0", "-fPIC", "--coverage", "-fno-inline"])
    native.run(["gcc", "--coverage", "-shared", *map(str, safety), "-o", native.SAFETY_LIBRARY], folder)
    ran = native.safety_tests(folder)
    assert ran.returncode == 0, ran.stdout
    command = ["gcov", "--branch-probabilities", "--json-format", *(source.stem for source in native.SAFETY_SOURCES)]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    files = []
    for source in native.SAFETY_SOURCES:
        report = json.loads(gzip.decompress((folder / f"{source.stem}.gcov.json.gz").read_bytes()))
        files += [file for file in report["files"] if file["file"].endswith(source.name)]
    return files


def test_every_line_is_executed(coverage: list[dict[str, Any]]) -> None:
    lines = [(file["file"], line["line_number"], line["count"]) for file in coverage for line in file["lines"]]
    assert len(lines) > 80
    assert [line for line in lines if line[2] == 0] == []


def test_every_branch_is_taken_and_not_taken(coverage: list[dict[str, Any]]) -> None:
    branches = [
        (file["file"], line["line_number"], number, branch["count"])
        for file in coverage
        for line in file["lines"]
        for number, branch in enumerate(line["branches"])
    ]
    assert len(branches) > 60
    assert [branch for branch in branches if branch[3] == 0] == []
