"""What every message about wrong input has in common."""

from __future__ import annotations


def check_message(errors: str, command: str, *names: str) -> None:
    """One line that begins with the command and names what it must."""
    lines = errors.splitlines()
    assert len(lines) == 1, errors
    assert lines[0].startswith(f"crux {command}: ")
    assert "Traceback" not in errors
    assert "internal error" not in errors
    missing = [name for name in names if name not in lines[0]]
    assert not missing, f"{missing} not named in: {lines[0]}"
