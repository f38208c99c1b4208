"""NOTICE against the locks, the packages' own metadata and what the programs really load."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import distribution

import pytest
from crux_tools.paths import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

LINKED, STATIC, IMAGES, USER, DEVELOPMENT, DOCS, COPIED = range(1, 8)  # the tables of NOTICE
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PROGRAMS = (
    "runtime/app/crux-runtime",
    "runtime/app/crux-recompute",
    "firmware/libcrux_nodes.so",
    "planner/libcrux_bound.so",
    "planner/libcrux_chain.so",
    "planner/libcrux_checker.so",
    "planner/libcrux_path.so",
    "planner/libcrux_reach.so",
    "planner/libcrux_stages.so",
    "planner/libcrux_tape.so",
)
INSTALLED = ("operator.lock", "simulation.lock", "campaign.lock", "development.lock", "uv.lock.txt")
LOADED = """
import importlib, pathlib, pkgutil
for name in ("crux_contracts", "crux_planner", "crux_can_kernel", "crux_tools", "crux_simulation"):
    for module in pkgutil.walk_packages(importlib.import_module(name).__path__, name + "."):
        importlib.import_module(module.name)
import casadi, matplotlib.pyplot, mujoco, trimesh, websockets
x = casadi.SX.sym("x")
casadi.nlpsol("s", "ipopt", {"x": x, "f": x * x}, {"ipopt.print_level": 0})(x0=1)
print(pathlib.Path("/proc/self/maps").read_text())
"""


def table(section: int) -> dict[str, str]:
    """Licences by name in one table of NOTICE."""
    text = (ROOT / "NOTICE").read_text(encoding="utf-8").split("\n== ")[section]
    rows = re.findall(r"^(\S+) {2,}(\S.*?)(?: {2,}.*)?$", text, re.MULTILINE)
    assert len(rows) == len(dict(rows)), "a name twice"
    return dict(rows)


def is_gpl(licence: str) -> bool:
    """The GNU GPL without an exception for what links to it."""
    return any(part.startswith("GPL-") and " WITH " not in part for part in re.split(" AND | OR ", licence))


def locked(*locks: str) -> set[str]:
    text = "".join((ROOT / "tools" / "setup" / name).read_text(encoding="utf-8") for name in locks or INSTALLED)
    return {canonicalize_name(name) for name in re.findall(r"^([\w.-]+)==", text, re.MULTILINE)}


def needed(requirements: list[str]) -> set[str]:
    """These packages and all that they need, by the installed packages' metadata."""
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        wanted = waiting.pop()
        if (name := canonicalize_name(wanted.name)) not in found:
            found.add(name)
            inner = [Requirement(text) for text in distribution(name).requires or []]
            extras = ["", *wanted.extras]
            waiting += [i for i in inner if i.marker is None or any(i.marker.evaluate({"extra": e}) for e in extras)]
    return found


def test_the_licence_is_apache_everywhere() -> None:
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert re.match(r"\s*Apache License\s+Version 2\.0, January 2004", text)
    assert "END OF TERMS AND CONDITIONS" in text
    assert PROJECT["license"] == "Apache-2.0"
    assert "Apache License, Version 2.0" in (ROOT / "NOTICE").read_text(encoding="utf-8").split("==")[0]


def test_every_locked_package_is_in_notice_and_no_other() -> None:
    development = set(table(DEVELOPMENT)) - {"googletest", "nlohmann-json"}  # from Debian
    assert set(table(USER)) | development == locked()
    assert set(table(DOCS)) == locked("docs.lock") - set(table(USER)) - development
    crates = re.findall(r'^name = "(.*)"', (ROOT / "runtime/telemetry/mcap_c/Cargo.lock.in").read_text(), re.MULTILINE)
    assert set(table(STATIC)) - {"Eigen", "Monocypher", "PIQP"} == set(crates) - {"mcap_c"}


def test_what_is_copied_into_the_repository_is_named_with_its_licence() -> None:
    folder = ROOT / "tools/crux_tools/view/page/three"
    assert table(COPIED) == {"three.js": "MIT", "scaler.urdf": "MIT"}
    assert "MIT License" in (ROOT / "examples" / "makers-scaler" / "LICENSE").read_text(encoding="utf-8")
    assert "The MIT License" in (folder / "LICENSE").read_text(encoding="utf-8")
    assert "@license\n * Copyright 2010" in (folder / "three.core.min.js").read_text(encoding="utf-8")[:60]


def test_licences_are_those_that_the_packages_name() -> None:
    licences = table(USER) | table(DEVELOPMENT)
    named = {name: distribution(name).metadata.get_all("License-Expression") for name in locked()}
    stated = {name: licence[0] for name, licence in named.items() if licence}
    assert len(stated) > len(named) / 3
    assert {name: licences[name] for name in stated} == stated


def test_what_a_user_needs_is_listed_apart_and_free_of_the_gpl() -> None:
    known: set[str] = set()
    asked = list(PROJECT["dependencies"])
    for lock, extra in (("operator.lock", None), ("simulation.lock", "sim"), ("campaign.lock", "campaign")):
        asked += PROJECT["optional-dependencies"].get(extra, [])
        assert locked(lock) == needed(asked) - known
        known |= locked(lock)
    assert set(table(USER)) == known
    assert is_gpl(table(DEVELOPMENT)["unicorn"])
    for section in (LINKED, STATIC, IMAGES, USER, COPIED):
        assert not {name: licence for name, licence in table(section).items() if is_gpl(licence)}


@pytest.mark.parametrize("program", PROGRAMS)
def test_programs_link_only_what_notice_names(program: str) -> None:
    shown = subprocess.run(["ldd", ROOT / "build" / "cmake" / program], capture_output=True, text=True, check=True)
    libraries = re.findall(r"^\s*(?:\S*/)?([^\s/]+)\.so\S*", shown.stdout, re.MULTILINE)
    names = {re.sub(r"-[\d.]+$", "", name) if name not in table(LINKED) else name for name in libraries}
    assert "libc" in names
    assert names - {"linux-vdso"} <= set(table(LINKED))


def test_crux_loads_only_packages_that_a_user_needs() -> None:
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = {line.split()[-1].partition("/site-packages/")[2] for line in done.stdout.splitlines() if ".so" in line}
    used = {name for name in locked() if loaded & {str(file) for file in distribution(name).files or []}}
    assert {"casadi", "numpy", "piqp", "highspy", "mujoco-core"} <= used
    assert used <= set(table(USER))
    assert not re.search("unicorn|libreadline|libcrux_emulated", done.stdout)


def test_make_climb_does_not_build_what_links_to_the_gpl() -> None:
    ninja = ["ninja", "-C", str(ROOT / "build" / "cmake"), "-t", "inputs", "crux_programs"]
    inputs = subprocess.run(ninja, capture_output=True, text=True, check=True).stdout
    assert "crux-runtime" in inputs
    assert "emulated" not in inputs
    assert "unicorn" not in inputs
