"""What is installed runs away from the checkout, and nothing in it says where it was built."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from crux_tools.paths import ROOT

BIN = ROOT / ".venv" / "bin"
SETUP = ROOT / "tools" / "setup"
OWN = f"3.{sys.version_info.minor}"
PYTHONS = [OWN, *(pytest.param(f"3.{minor}", marks=pytest.mark.sweep) for minor in (11, 12, 13) if f"3.{minor}" != OWN)]


def run(*words: str | Path, status: int = 0) -> str:
    """Standard output of a program in an environment that knows nothing of the checkout."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": os.environ["HOME"]}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False, cwd="/", timeout=600)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


def install_programs(prefix: Path) -> None:
    for component in ("runtime", "planner", "sim"):
        run("cmake", "--install", ROOT / "build" / "cmake", "--prefix", prefix, "--strip", "--component", component)


def interpreter(version: str) -> str:
    """The path of python3.x; a place where pyenv keeps them counts."""
    found = shutil.which(f"python{version}")
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python{version}"))
    if found is None and not kept:
        pytest.skip(f"no Python {version} here")
    return str(kept[-1]) if kept else str(found)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For this machine, with the programs that were built here."""
    folder = tmp_path_factory.mktemp("wheel")
    words = ["build", "-q", "--wheel", "--no-build-isolation", "--offline", "-o", str(folder), str(ROOT)]
    subprocess.run([BIN / "uv", *words, "--python", BIN / "python"], check=True)
    (found,) = folder.glob("crux_climb-*-py3-none-linux_*.whl")
    return found


def environment_with(wheel: Path, version: str, folder: Path, *locks: str) -> Path:
    """A fresh virtual environment with the locked packages and the wheel."""
    subprocess.run([interpreter(version), "-m", "venv", "--without-pip", folder], check=True)
    uv = [str(BIN / "uv"), "pip"]
    into = ["-q", "--no-config", "--system-certs", "--python", str(folder / "bin" / "python")]
    locked = [str(SETUP / lock) for lock in locks]
    subprocess.run([*uv, "sync", *into, "--require-hashes", *locked], check=True)
    subprocess.run([*uv, "install", *into, "--no-deps", str(wheel)], check=True)
    return folder


def test_installed_programs_run_where_they_are_moved_and_tell_no_place(tmp_path: Path) -> None:
    install_programs(tmp_path / "first")
    prefix = (tmp_path / "first").rename(tmp_path / "second")
    files = [path for path in prefix.rglob("*") if path.is_file()]
    planner = {f"libcrux_{part}.so" for part in ("bound", "chain", "checker", "path", "reach", "stages", "tape")}
    libraries = {*planner, "libcrux_sim.so", "liblcm.so.1"}
    assert {"crux-runtime", "crux-recompute", *libraries} <= {path.name for path in files}
    places = (ROOT, ROOT.resolve(), Path.home(), Path("/tmp"))
    told = re.compile("|".join(re.escape(f"{place}/") for place in places).encode())
    assert [(path.name, told.findall(path.read_bytes())) for path in files if told.search(path.read_bytes())] == []
    assert "usage: crux-runtime" in run(prefix / "bin" / "crux-runtime", "--help")
    for name in ("bin/crux-runtime", "lib/crux/libcrux_sim.so"):
        assert f"{prefix}/" in run("ldd", prefix / name)
    robot = prefix / "share" / "crux" / "robots" / "scaler"
    refused = run(prefix / "bin" / "crux-runtime", "--robot", robot, "--pace", "x", status=2)
    assert "--pace" in refused


@pytest.mark.parametrize("version", PYTHONS)
def test_the_wheel_plans_in_a_fresh_environment(wheel: Path, version: str, tmp_path: Path) -> None:
    folder = environment_with(wheel, version, tmp_path / "venv", "operator.lock")
    assert not [path for path in folder.rglob("*.pth") if "crux" in path.name]
    python, crux = folder / "bin" / "python", folder / "bin" / "crux"
    places = run(python, "-c", "from crux_tools.paths import ROOT, SCENARIOS; print(ROOT, SCENARIOS)").split()
    assert all(place.startswith(str(folder)) for place in places)
    assert run(python, "--version").startswith(f"Python {version}")
    (runtime,) = folder.rglob("crux-runtime")
    assert "--lcm" in run(runtime, "--help")
    plan = tmp_path / "plan.mcap"
    planned = json.loads(run(crux, "plan", f"{places[1]}/climb-one-step.yaml", "-o", plan, "--json"))
    assert planned["ok"] is True
    assert json.loads(run(crux, "check", plan, "--json"))["ok"] is True
    refused = run(crux, "climb", plan, "-o", tmp_path / "log.mcap", status=2)
    assert refused == f"crux climb: needs mujoco, which is not installed: pip install '{wheel}[sim,campaign]'\n"


@pytest.mark.sweep
def test_a_climb_from_the_wheel(wheel: Path, tmp_path: Path) -> None:
    folder = environment_with(wheel, OWN, tmp_path / "venv", "operator.lock", "simulation.lock")
    plan, log = tmp_path / "plan.mcap", tmp_path / "log.mcap"
    crux, scenario = folder / "bin" / "crux", next(folder.rglob("climb-one-step.yaml"))
    run(crux, "plan", scenario, "-o", plan)
    assert json.loads(run(crux, "climb", plan, "-o", log, "--json"))["ok"] is True
    assert json.loads(run(crux, "replay", log, "--check", "--json"))["ok"] is True


def test_this_checkout_needs_what_the_wheel_says() -> None:
    """requires-python covers the interpreter that tests run in, and every one for which packages are made."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (least, most) = re.findall(r'^requires-python = ">=3\.(\d+),<3\.(\d+)"$', text, re.MULTILINE)[0]
    made = re.findall(r"deb\d+:3\.(\d+)", (ROOT / "packaging" / "packages").read_text(encoding="utf-8"))
    assert {int(minor) for minor in made} | {sys.version_info.minor} <= set(range(int(least), int(most)))
