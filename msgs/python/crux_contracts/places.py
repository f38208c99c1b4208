"""Where the contracts that are read at run time lie: beside the sources, or inside the installed package."""

from __future__ import annotations

from pathlib import Path

_INSTALLED = Path(__file__).resolve().parent / "data"
MSGS = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).resolve().parents[2]
