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
def room() -> Path:
    """A folder with the safety room as it is: its objects, and the library made of them."""
    folder = native.build_folder("mutants")
    safety = native.objects(native.SAFETY_SOURCES, folder, FLAGS)
    native.run(["gcc", "-shared", *map(str, safety), "-o", native.SAFETY_LIBRARY], folder)
    return folder


def _survives(room: Path, number: int, mutant: Mutant, source: Path) -> bool:
    """Whether all tests pass with the mutant in place. One that does not compile or link counts as killed."""
    folder = room / f"{number:03d}"
    folder.mkdir(exist_ok=True)
    changed = folder / source.name
    changed.write_text(apply(mutant, source.read_text(encoding="utf-8")), encoding="utf-8")
    others = [str(room / f"{other.stem}.o") for other in native.SAFETY_SOURCES if other != source]
    # ABI and warnings as before; an unused variable is no reason to call a mutant dead.
    command = ["gcc", "-std=c11", *FLAGS, "-w", "-ffp-contract=off", *native.INCLUDES, "-shared", str(changed), *others]
    try:
        native.run([*command, "-o", str(folder / native.SAFETY_LIBRARY)], room)
    except native.CompileError:
        return False
    try:
        done = native.safety_tests(folder, "--gtest_fail_fast", "--gtest_brief=1", limit_s=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


@pytest.mark.sweep
def test_every_mutant_is_killed_or_explained(room: Path) -> None:
    unchanged = native.safety_tests(room)
    assert unchanged.returncode == 0, unchanged.stdout
    todo = [
        (mutant, source)
        for source in native.SAFETY_SOURCES
        for mutant in mutants(source.name, source.read_text(encoding="utf-8"))
    ]
    assert len(todo) > 100
    with ThreadPoolExecutor(native.JOBS) as pool:
        alive = list(pool.map(lambda item: _survives(room, item[0], *item[1]), enumerate(todo)))
    survivors = {mutant.key for (mutant, _), survived in zip(todo, alive, strict=True) if survived}
    explained = yaml.safe_load(EXPLAINED.read_text(encoding="utf-8"))
    assert survivors - set(explained) == set(), "mutants that no test notices"
    assert set(explained) - survivors == set(), "explanations of mutants that are killed or no more"
