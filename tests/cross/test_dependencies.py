"""What the Python packages import is asked for in pyproject.toml, not had by chance from another package."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "msgs/python/crux_contracts",
    "planner/crux_planner",
    "tools/crux_can_kernel",
    "tools/crux_simulation",
    "tools/crux_tools",
)
OPTIONAL = {"pandas", "rerun"}  # used where a user has them; crux says so where not


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _imported() -> dict[str, str]:
    """Top-level modules, each with a file that imports it."""
    found: dict[str, str] = {}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [node.module]
            found |= {name.split(".")[0]: str(path.relative_to(ROOT)) for name in names}
    return found


def test_what_is_imported_is_asked_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    words = [*project["dependencies"], *(word for words in project["optional-dependencies"].values() for word in words)]
    asked = {_plain(re.split(r"[^A-Za-z0-9._-]", word)[0]) for word in words}
    offered = packages_distributions()
    missing = {
        name: path
        for name, path in _imported().items()
        if name not in sys.stdlib_module_names | OPTIONAL
        and not name.startswith("crux_")
        and not {_plain(each) for each in offered.get(name, ["nobody"])} & asked
    }
    assert not missing
