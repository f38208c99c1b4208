"""The programs cross-built for arm64, under emulation: they compute what this machine's do, but for rounding."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from crux_contracts.places import MSGS
from crux_tools import cli
from crux_tools.paths import ROOT
from crux_tools.replay import recompute

pytestmark = pytest.mark.sweep
FOLDER = ROOT / "build" / "arm64"
ROUNDING = 1e-9  # SI units: another processor's libraries round otherwise


@pytest.fixture(scope="module")
def emulated() -> list[str]:
    """The words before the path of an arm64 program."""
    subprocess.run([ROOT / "packaging" / "cross", "arm64", "aarch64"], check=True, capture_output=True)
    libraries = FOLDER / "python" / "lib"
    return ["qemu-aarch64-static", "-L", f"{FOLDER}/sysroot", "-E", f"LD_LIBRARY_PATH={libraries}"]


def test_the_runtime_starts(emulated: list[str]) -> None:
    runtime = FOLDER / "cmake" / "runtime" / "app" / "crux-runtime"
    shown = subprocess.run([*emulated, runtime, "--help"], capture_output=True, text=True, check=True).stdout
    assert "usage: crux-runtime" in shown
    words = [*emulated, str(runtime), "--robot", str(ROOT / "msgs"), "--pace", "clock", "--insecure"]
    refused = subprocess.run(words, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert "robot.yaml" in refused.stderr


def test_a_climb_is_computed_again_but_for_rounding(
    emulated: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, log = tmp_path / "plan.mcap", tmp_path / "log.mcap"
    assert cli.main(["plan", str(MSGS / "scenarios" / "climb-one-step.yaml"), "-o", str(plan)]) == 0
    assert cli.main(["climb", str(plan), "-o", str(log)]) == 0
    here = recompute.recompute(log)
    assert here.ok
    assert here.largest == 0.0

    wrapper = tmp_path / "crux-recompute"
    wrapper.write_text(f'#!/bin/sh\nexec {" ".join(emulated)} {FOLDER}/cmake/runtime/app/crux-recompute "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setattr(recompute, "built", lambda _name: wrapper)
    there = recompute.recompute(log, ROUNDING)
    assert there.first_difference is None
    assert there.missing_cycle is None
    assert there.cycles == here.cycles > 5000
    assert there.largest < ROUNDING
