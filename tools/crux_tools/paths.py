"""Where the other components put what the tools start or read: in a checkout, or where crux is installed.

crux is installed from a Debian package, or by pip: from its wheel, which carries the programs, or from a clone.
"""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

from crux_contracts.places import MSGS

from crux_tools.errors import UsageError

DISTRIBUTION = "crux-climb"  # the name for pip, that of pyproject.toml
ROOT = Path(__file__).resolve().parents[2]
DEBIAN = Path(__file__).is_relative_to("/usr/lib/crux/python")  # packaging/packages
IN_DEBIAN = "install the Debian package crux-sim"
NO_PROGRAMS = "this crux was installed without its programs; install the wheel for this kind of machine, or a clone"
PROGRAMS = Path(__file__).resolve().parent / "programs"  # of the wheel: packaging/wheel_programs.py
CHECKOUT = (ROOT / "pyproject.toml").is_file()
BUILD_DIR = ROOT / "build" / "cmake"
SCENARIOS = MSGS / "scenarios"
SCHEMAS = ROOT / "build" / "gen" / "schemas" if CHECKOUT else MSGS / "schemas"
WORLDS = ROOT / "tools" / "worlds" if CHECKOUT else MSGS / "worlds"


def built(relative: str) -> Path:
    """A product of the build, e.g. runtime/app/crux-runtime; raises UsageError when it has not been built.

    Where crux is installed, it is the file of that name in the wheel, or in bin or lib/crux under this Python's prefix.
    """
    name, places = Path(relative).name, [BUILD_DIR / relative]
    development = relative.endswith((".elf", "emulated.so"))
    advice = f"build the project first (make {'build' if development else 'programs'})"
    if not CHECKOUT:
        advice = f"{IN_DEBIAN if DEBIAN else NO_PROGRAMS} (emulated boards: only in a checkout)"
        places = [PROGRAMS / name, *(Path(sys.prefix) / folder / name for folder in ("lib/crux", "bin"))]
    for place in places:
        if place.exists():
            return place
    raise UsageError(f"{places[0]} is missing: {advice}")


def how_to_add(module: str) -> str:
    """What installs a Python module that not every level or extra has, for the way in which crux was installed."""
    if CHECKOUT:
        return make_target_with(module)
    return IN_DEBIAN if DEBIAN else f"pip install {shlex.quote(f'{_installed_from()}[sim,campaign]')}"


def _installed_from() -> str:
    """The wheel or the clone that pip installed; the distribution's name where it came from a package index."""
    from importlib import metadata  # it and tomllib take 0.03 s of CPU, which hardly any command needs

    told = json.loads(metadata.distribution(DISTRIBUTION).read_text("direct_url.json") or "{}").get("url", "")
    url = urlsplit(told)
    return unquote(url.path) if url.scheme == "file" else told or DISTRIBUTION


def make_target_with(module: str) -> str:
    """The least that installs a package which `make climb` does not: its lock says so; only in a checkout."""
    extras = (ROOT / "tools" / "setup" / "campaign.lock").read_text(encoding="utf-8")
    package = module.split(".", maxsplit=1)[0].replace("_", "-")
    return "make extras" if f"\n{package}==" in f"\n{extras}" else "make setup"


def version_and_requirements() -> tuple[str, list[str]]:
    """Of the checkout's pyproject.toml, or of the installed package; requirements as in `numpy~=2.1`."""
    if not CHECKOUT:
        from importlib import metadata

        return metadata.version(DISTRIBUTION), metadata.requires(DISTRIBUTION) or []
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    return str(project["version"]), [*project["dependencies"], *(name for extra in extras for name in extra)]
