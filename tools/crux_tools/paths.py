"""Where the other components put what the tools start or read: in a checkout, or where crux is installed."""

from __future__ import annotations

import sys
import tomllib
from importlib import metadata
from pathlib import Path

from crux_contracts.places import MSGS

from crux_tools.errors import UsageError

ROOT = Path(__file__).resolve().parents[2]
CHECKOUT = (ROOT / "pyproject.toml").is_file()
BUILD_DIR = ROOT / "build" / "cmake"
SCENARIOS = MSGS / "scenarios"
WORLDS = ROOT / "tools" / "worlds" if CHECKOUT else MSGS / "worlds"


def built(relative: str) -> Path:
    """A product of the build, e.g. runtime/app/crux-runtime; raises UsageError when it has not been built.

    Where crux is installed, it is the file of that name in bin or lib/crux under the prefix of this Python.
    """
    development = relative.endswith((".elf", "emulated.so"))
    cure = f"build the project first (make {'build' if development else 'programs'})"
    places = [BUILD_DIR / relative]
    if not CHECKOUT:
        cure = "install crux-sim (emulated boards: only in a checkout)"
        places = [Path(sys.prefix) / folder / places[0].name for folder in ("lib/crux", "bin")]
    for place in places:
        if place.exists():
            return place
    raise UsageError(f"{places[0]} is missing: {cure}")


def make_target_with(module: str) -> str:
    """The least that installs a package which `make climb` does not: its lock says so; only in a checkout."""
    extras = (ROOT / "tools" / "setup" / "campaign.lock").read_text(encoding="utf-8")
    package = module.split(".", maxsplit=1)[0].replace("_", "-")
    return "make extras" if f"\n{package}==" in f"\n{extras}" else "make setup"


def version_and_requirements() -> tuple[str, list[str]]:
    """Of the checkout's pyproject.toml, or of the installed package; requirements as in `numpy==2.4.6`."""
    if not CHECKOUT:
        return metadata.version("crux"), metadata.requires("crux") or []
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    return str(project["version"]), [*project["dependencies"], *(name for extra in extras for name in extra)]
