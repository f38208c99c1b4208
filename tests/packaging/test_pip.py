"""`pip install` of the wheel or of a clone: from the index, into fresh environments and bare systems, up to a climb."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest
from crux_tools import paths
from crux_tools.paths import DISTRIBUTION, ROOT, how_to_add
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from test_install import BIN, interpreter

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SETUP = ROOT / "tools" / "setup"
TEXTS = ("*.md", "*.py", "*.sh", "*.txt", "*.cmake", "*.service", "Makefile")
PLACES = ("docs", "examples", "firmware", "msgs", "packaging", "planner", "runtime", "tools")
OF_OTHERS = {"pandas"}  # not locked, but the package of that name is meant
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")


def locked() -> dict[str, str]:
    """Versions by name."""
    text = "".join(file.read_text(encoding="utf-8") for file in sorted(SETUP.glob("*.lock")))
    return {
        canonicalize_name(name): version for name, version in re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE)
    }


def packages_fetched(text: str) -> Iterator[str]:
    """What `pip install` in a text would look for on an index: no option nor its value, path, or what is filled in;
    and each name that has one of our extras, wherever it stands."""
    yield from re.findall(r"(?<![\w./}-])([a-z][\w-]*)\[(?:sim|campaign)\b", text)
    for line in re.findall(r"pip install ((?:(?!\"\))[^\n`;&|<])*)", text):
        words = [word.strip("\"'(),:") for word in line.split()]
        for before, word in zip(["", *words], words, strict=False):
            if not before.startswith("--") and not re.search(r"^-|[/${}\\]|^\.|\.whl", word):
                yield re.split(r"[\[=<>~]", word)[0]


def test_advice_is_read_as_pip_would() -> None:
    text = (
        "`pip install 'crux[sim]'` pip install -q ./a.whl other==1 \n pip install --target x '.[sim]' `pip install .`"
    )
    assert {*packages_fetched(text)} == {"crux", "other"}
    assert {*packages_fetched("install crux-sim, or by pip 'crux[sim,campaign]'")} == {"crux"}


def test_no_advice_fetches_a_package_that_is_not_ours_or_locked() -> None:
    files = [file for place in PLACES for form in TEXTS for file in sorted((ROOT / place).rglob(form))]
    files += [*ROOT.glob("*.md"), ROOT / "Makefile", *(file for file in SETUP.iterdir() if file.suffix == "")]
    texts = {file: file.read_text(encoding="utf-8") for file in files if file.is_file()}
    assert sum("pip install" in text for text in texts.values()) > 3
    known = {*locked(), DISTRIBUTION, *OF_OTHERS}
    found = {(str(file.relative_to(ROOT)), name) for file, text in texts.items() for name in packages_fetched(text)}
    assert not {(file, name) for file, name in found if name not in known}


def test_the_distribution_has_one_name_and_ranges_that_the_locks_fulfil() -> None:
    assert PROJECT["name"] == DISTRIBUTION
    wanted = [
        *PROJECT["dependencies"],
        *(each for extra in PROJECT["optional-dependencies"].values() for each in extra),
    ]
    requirements = [Requirement(text) for text in wanted]
    assert not [each for each in requirements if locked()[canonicalize_name(each.name)] not in each.specifier]
    assert [each.name for each in requirements if re.match("==[^*]*$", str(each.specifier))] == ["mujoco"]


@pytest.mark.parametrize(
    ("url", "wanted"),
    [
        ("file:///my%20wheels/c.whl", "pip install '/my wheels/c.whl[sim,campaign]'"),
        ("file:///clone", "pip install '/clone[sim,campaign]'"),
        (None, f"pip install '{DISTRIBUTION}[sim,campaign]'"),
    ],
)
def test_pip_is_advised_from_where_crux_came(monkeypatch: pytest.MonkeyPatch, url: str | None, wanted: str) -> None:
    told = None if url is None else json.dumps({"url": url})
    monkeypatch.setattr(metadata, "distribution", lambda _name: SimpleNamespace(read_text=lambda _file: told))
    monkeypatch.setattr(paths, "CHECKOUT", False)
    assert how_to_add("mujoco") == wanted
    monkeypatch.setattr(paths, "DEBIAN", True)
    assert "pip" not in how_to_add("mujoco")
    assert "crux-sim" in how_to_add("mujoco")


def climb_of(folder: Path) -> None:
    """The demo in an environment that knows nothing of the checkout: standard output is one JSON object."""
    environment = {"PATH": "/usr/bin:/bin", "HOME": os.environ["HOME"]}
    words = [str(folder / "bin" / "crux"), "demo", "--json"]
    done = subprocess.run(words, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["ok"] is True
    assert "climbed: the robot is at the goal" in done.stderr
    assert (folder / "crux-demo" / "report.html").stat().st_size > 100_000


@pytest.fixture(scope="module")
def portable_wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([ROOT / "packaging" / "wheel", folder], check=True, capture_output=True)
    (found,) = folder.glob("crux_climb-*-py3-none-manylinux_*.whl")
    return found


@pytest.mark.sweep
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_pip_installs_the_wheel_and_it_climbs(portable_wheel: Path, version: str, tmp_path: Path) -> None:
    folder = tmp_path / "venv"
    subprocess.run([interpreter(version), "-m", "venv", folder], check=True)
    subprocess.run([folder / "bin" / "pip", "install", "-q", f"{portable_wheel}[sim]"], check=True)
    climb_of(folder)


@pytest.mark.sweep
@pytest.mark.parametrize("version", ["3.11", "3.13"])
def test_the_oldest_packages_of_the_ranges_climb(portable_wheel: Path, version: str, tmp_path: Path) -> None:
    folder = tmp_path / "venv"
    subprocess.run([interpreter(version), "-m", "venv", "--without-pip", folder], check=True)
    words = [str(BIN / "uv"), "pip", "install", "-q", "--no-config", "--system-certs", "--resolution", "lowest-direct"]
    words += ["--only-binary", ":all:", "--python", str(folder / "bin" / "python")]
    subprocess.run([*words, f"{portable_wheel}[sim]"], check=True)
    climb_of(folder)


@pytest.mark.sweep
def test_pip_builds_and_installs_a_clone(tmp_path: Path) -> None:
    folder, clone = tmp_path / "venv", tmp_path / "my clone"
    subprocess.run(["git", "clone", "-q", ROOT, clone], check=True)
    subprocess.run([interpreter("3.11"), "-m", "venv", folder], check=True)
    subprocess.run([folder / "bin" / "pip", "install", "-q", f"{clone}[sim]"], check=True)
    climb_of(folder)


@pytest.mark.sweep
@pytest.mark.skipif(os.geteuid() != 0, reason="root alone makes another root")
@pytest.mark.parametrize("suite", ["bookworm", "trixie"])
def test_the_wheel_climbs_on_a_debian_with_python_alone(portable_wheel: Path, suite: str, tmp_path: Path) -> None:
    steps = f"""set -e; cd /root; python3 -m venv venv
    venv/bin/pip install -q --no-cache-dir --cert {CERTIFICATES} /{portable_wheel.name}[sim]
    venv/bin/crux demo -o out --json >demo.json; venv/bin/crux replay out/climb.mcap --check --json >replay.json
    ! venv/bin/crux status 2>status.txt"""
    hooks = [f"copy-in {portable_wheel} /", f"copy-in {CERTIFICATES} {CERTIFICATES.parent}"]
    hooks += [f'chroot "$1" sh -c {shlex.quote(steps)}']
    words = ["mmdebstrap", "-q", "--variant=minbase", "--include=python3-venv,ca-certificates"]
    system = tmp_path / "root"
    subprocess.run([*words, *(f"--customize-hook={hook}" for hook in hooks), suite, system], check=True)
    assert not [*system.rglob("libEGL*"), *system.glob("usr/lib/*/libglib*")]
    for result in ("demo", "replay"):
        assert json.loads((system / "root" / f"{result}.json").read_text())["ok"] is True
    assert "no runtime answers" in (system / "root" / "status.txt").read_text()
    assert "No pictures: this machine has no OpenGL" in (system / "root" / "out" / "report.html").read_text()
