"""Writes the software bill of materials (CycloneDX 1.6, JSON): every locked Python package and crate with version,
hashes and the licence that NOTICE gives it, sources that are fetched, and Debian packages as they are installed.

    python tools/setup/sbom.py build/crux.cdx.json
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SETUP = ROOT / "tools" / "setup"
LINKED, STATIC, IMAGES, USER, DEVELOPMENT, DOCS = range(1, 7)  # the tables of NOTICE
PYTHON_LOCKS = ("operator.lock", "simulation.lock", "campaign.lock", "development.lock", "uv.lock.txt", "docs.lock")
CRATES = {"runtime/telemetry/mcap_c/Cargo.lock.in": "required", "tests/firmware/metapac/Cargo.lock": "excluded"}


def licences(*tables: int) -> dict[str, str]:
    """By name, of tables of NOTICE."""
    parts = (ROOT / "NOTICE").read_text(encoding="utf-8").split("\n== ")
    rows = (re.findall(r"^(\S+) {2,}(\S.*?)(?: {2,}.*)?$", parts[table], re.MULTILINE) for table in tables)
    return dict(row for table in rows for row in table)


def component(purl: str, name: str, version: str, scope: str, licence: str | None, **more: Any) -> dict[str, Any]:
    """`scope` required: a user runs it; excluded: tests, development and the docs site alone."""
    found = {"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl, "scope": scope}
    return found | ({"licenses": [{"license": {"name": licence}}]} if licence else {}) | more


def python_packages() -> Iterator[dict[str, Any]]:
    of_users, of_all = licences(USER), licences(USER, DEVELOPMENT, DOCS)
    for lock in PYTHON_LOCKS:
        text = (SETUP / lock).read_text(encoding="utf-8")
        for name, version, body in re.findall(r"^([\w.-]+)==([^\s\\]+)(.*(?:\n .*)*)", text, re.MULTILINE):
            hashes = [{"alg": "SHA-256", "content": digest} for digest in re.findall("sha256:([0-9a-f]{64})", body)]
            scope = "required" if name in of_users else "excluded"
            yield component(f"pkg:pypi/{name}@{version}", name, version, scope, of_all[name], hashes=hashes)


def fetched_sources() -> Iterator[dict[str, Any]]:
    """C and C++ sources that come with Python packages (tools/setup/source_package)."""
    text = (SETUP / "setup").read_text(encoding="utf-8")
    for name, version, digest in re.findall(r'source_package" "\$venv" (\S+) (\S+) ([0-9a-f]{64})', text):
        licence = {each.lower(): licence for each, licence in licences(STATIC).items()}[name.removeprefix("py")]
        hashes = [{"alg": "SHA-256", "content": digest}]
        yield component(f"pkg:pypi/{name}@{version}?type=sdist", name, version, "required", licence, hashes=hashes)


def crates() -> Iterator[dict[str, Any]]:
    known = licences(STATIC)
    for lock, scope in CRATES.items():
        for package in tomllib.loads((ROOT / lock).read_text(encoding="utf-8"))["package"]:
            if "checksum" in package:  # the others are crux's own
                name, version = package["name"], package["version"]
                hashes = [{"alg": "SHA-256", "content": package["checksum"]}]
                yield component(f"pkg:cargo/{name}@{version}", name, version, scope, known.get(name), hashes=hashes)


def debian_packages() -> Iterator[dict[str, Any]]:
    """As installed here; without a version where they are not."""
    wanted = re.sub(r"#.*", "", (SETUP / "apt-packages.txt").read_text(encoding="utf-8")).split()
    try:
        words = ["dpkg-query", "-W", "-f=${Package} ${Version}\n", *wanted]
        shown = subprocess.run(words, capture_output=True, text=True, check=False).stdout
    except FileNotFoundError:
        shown = ""
    versions = dict(line.split() for line in shown.splitlines() if len(line.split()) == 2)
    for name in wanted:
        version = versions.get(name, "")
        purl = f"pkg:deb/debian/{name}" + (f"@{version}" if version else "")
        yield component(purl, name, version, "required", None)


def main() -> None:
    parser = argparse.ArgumentParser(description="writes the software bill of materials")
    parser.add_argument("file", type=Path)
    file = parser.parse_args().file
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    crux = {"type": "application", "bom-ref": "crux", "name": "crux", "version": project["version"]}
    crux["licenses"] = [{"license": {"id": project["license"]}}]
    found: dict[str, dict[str, Any]] = {}
    for each in (*python_packages(), *fetched_sources(), *crates(), *debian_packages()):
        found.setdefault(each["purl"], each)  # a crate may be in both locks: what users run comes first
    bom = {"bomFormat": "CycloneDX", "specVersion": "1.6", "version": 1, "metadata": {"component": crux}}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(bom | {"components": list(found.values())}, indent=1) + "\n", encoding="utf-8")
    print(f"{file}: {len(found)} components")


if __name__ == "__main__":
    main()
