"""Generator of everything that is derived from the contracts in msgs/: C, C++, Python and ros2msg."""

from __future__ import annotations

from pathlib import Path


def write_changed(path: Path, text: str) -> None:
    """Writes a file whose content is another one; one that stays the same keeps its time stamp."""
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
