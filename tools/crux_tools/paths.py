"""Where the other rooms put what the tools start or read."""

from __future__ import annotations

from pathlib import Path

from crux_tools.errors import UsageError

ROOT = Path(__file__).resolve().parents[2]
ROBOTS_DIR = ROOT / "msgs" / "robots"
BUILD_DIR = ROOT / "build" / "cmake"


def robot_dir(name: str) -> Path:
    """Folder of a robot description; raises UsageError when there is none of that name."""
    folder = ROBOTS_DIR / name
    if not (folder / "robot.yaml").is_file():
        known = ", ".join(sorted(path.parent.name for path in ROBOTS_DIR.glob("*/robot.yaml")))
        raise UsageError(f"there is no robot '{name}' under {ROBOTS_DIR}; known: {known}")
    return folder


def built(relative: str) -> Path:
    """A product of the build, e.g. runtime/app/crux-runtime; raises UsageError when it has not been built."""
    product = BUILD_DIR / relative
    if not product.exists():
        raise UsageError(f"{product} is missing: build the project first (make build)")
    return product
