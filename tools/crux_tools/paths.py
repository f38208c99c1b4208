"""Where the other rooms put what the tools start or read."""

from __future__ import annotations

from pathlib import Path

from crux_tools.errors import UsageError

ROOT = Path(__file__).resolve().parents[2]
BUILD_DIR = ROOT / "build" / "cmake"
SCENARIOS = ROOT / "msgs" / "scenarios"


def built(relative: str) -> Path:
    """A product of the build, e.g. runtime/app/crux-runtime; raises UsageError when it has not been built."""
    product = BUILD_DIR / relative
    if not product.exists():
        raise UsageError(f"{product} is missing: build the project first (make build)")
    return product
