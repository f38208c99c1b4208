"""The bill of materials against the locks, which it must name whole, and the set-up's list of Debian packages."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from crux_tools.paths import ROOT

SETUP = ROOT / "tools" / "setup"


@pytest.fixture(scope="module")
def components(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """By purl."""
    path = tmp_path_factory.mktemp("sbom") / "crux.cdx.json"
    subprocess.run([sys.executable, SETUP / "sbom.py", path], check=True, capture_output=True)
    bom = json.loads(path.read_text(encoding="utf-8"))
    assert (bom["bomFormat"], bom["specVersion"]) == ("CycloneDX", "1.6")
    found = {each["bom-ref"]: each for each in bom["components"]}
    assert len(found) == len(bom["components"]), "a reference twice"
    return found


def lines(path: Path, pattern: str) -> set[Any]:
    return set(re.findall(pattern, path.read_text(encoding="utf-8"), re.MULTILINE))


def test_it_names_all_that_is_locked_and_installed(components: dict[str, dict[str, Any]]) -> None:
    locks = ("operator.lock", "simulation.lock", "campaign.lock", "development.lock", "uv.lock.txt", "docs.lock")
    locked = [lines(SETUP / name, r"^([\w.-]+)==(\S+)") for name in locks]
    wanted = {f"pkg:pypi/{name}@{number}" for name, number in set.union(*locked)}
    crates = lines(ROOT / "runtime/telemetry/mcap_c/Cargo.lock.in", r'^name = "(.+)"\nversion = "(.+)"\nsource')
    wanted |= {f"pkg:cargo/{name}@{number}" for name, number in crates}
    assert len(crates) > 20
    assert wanted <= set(components)
    debian = {each.split("@")[0].rsplit("/", 1)[1] for each in components if each.startswith("pkg:deb/")}
    assert debian == lines(SETUP / "apt-packages.txt", r"^([\w.+-]+)$")
    assert f"pkg:pypi/numpy@{version('numpy')}" in components  # what runs here


def test_licences_scopes_and_hashes(components: dict[str, dict[str, Any]]) -> None:
    (unicorn,) = (each for each in components.values() if each["name"] == "unicorn")
    assert unicorn["scope"] == "excluded"
    assert unicorn["licenses"] == [{"license": {"name": "GPL-2.0-only"}}]
    for each in components.values():
        if not each["purl"].startswith("pkg:deb/"):
            assert each["hashes"], each["purl"]
        if each["scope"] == "required" and not each["purl"].startswith("pkg:deb/"):
            (licence,) = each["licenses"]
            assert not re.search(r"(?<![LA])GPL", licence["license"]["name"]), each["purl"]
