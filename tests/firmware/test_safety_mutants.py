"""Every mutant of the safety room is killed by its tests, or explained: what it changes cannot be seen."""

from __future__ import annotations

import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import native
import pytest
import yaml
from mutants import Mutant, apply, mutants

EXPLAINED = Path(__file__).with_name("explained_mutants.yaml")
FLAGS = ["-O1", "-fPIC", "-Wno-unused-parameter"]
TIME_LIMIT_S = 20.0  # a mutant may loop for ever


@pytest.fixture(scope="module")
def harness() -> Path:
    """The tests, linked against the safety room as a shared library that can be exchanged."""
    folder = native.build_folder("mutants")
    safety = native.objects(native.SAFETY_SOURCES, folder, FLAGS)
    rest = native.objects([*native.CORE_SOURCES, *native.SAFETY_TESTS], folder, FLAGS)
    native.run(["gcc", "-shared", *map(str, safety), "-o", "libsafety.so"], folder)
    tests = ["g++", *map(str, rest), "-L.", "-lsafety", "-lgtest_main", "-lgtest", "-o", "tests"]
    native.run(tests, folder)
    return folder


def _survives(harness: Path, number: int, mutant: Mutant, source: Path) -> bool:
    """Whether all tests pass with the mutant in place. One that does not compile or link counts as killed."""
    folder = harness / f"{number:03d}"
    folder.mkdir(exist_ok=True)
    changed = folder / source.name
    changed.write_text(apply(mutant, source.read_text(encoding="utf-8")), encoding="utf-8")
    others = [str(harness / f"{other.stem}.o") for other in native.SAFETY_SOURCES if other != source]
    # ABI and warnings as before; an unused variable is no reason to call a mutant dead.
    command = ["gcc", "-std=c11", *FLAGS, "-w", "-ffp-contract=off", *native.INCLUDES, "-shared", str(changed), *others]
    try:
        native.run([*command, "-o", str(folder / "libsafety.so")], harness)
    except native.CompileError:
        return False
    try:
        done = subprocess.run(
            [str(harness / "tests"), "--gtest_fail_fast", "--gtest_brief=1"],
            env={"LD_LIBRARY_PATH": str(folder)},
            capture_output=True,
            timeout=TIME_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def test_every_mutant_is_killed_or_explained(harness: Path) -> None:
    unchanged = subprocess.run(
        [str(harness / "tests")], env={"LD_LIBRARY_PATH": str(harness)}, capture_output=True, check=False
    )
    assert unchanged.returncode == 0, unchanged.stdout.decode()
    todo = [
        (mutant, source)
        for source in native.SAFETY_SOURCES
        for mutant in mutants(source.name, source.read_text(encoding="utf-8"))
    ]
    assert len(todo) > 100
    with ThreadPoolExecutor(native.JOBS) as pool:
        alive = list(pool.map(lambda item: _survives(harness, item[0], *item[1]), enumerate(todo)))
    survivors = {mutant.key for (mutant, _), survived in zip(todo, alive, strict=True) if survived}
    explained = yaml.safe_load(EXPLAINED.read_text(encoding="utf-8"))
    assert survivors - set(explained) == set(), "mutants that no test notices"
    assert set(explained) - survivors == set(), "explanations of mutants that are killed or no more"
