"""What takes long to compute, kept as arrays in ~/.cache/crux/reach from one plan to the next."""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from crux_planner.model.arrays import Array

_DIGEST = hashlib.sha256().digest_size


def cache_folder() -> Path:
    """~/.cache/crux/reach, or below $XDG_CACHE_HOME."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "crux" / "reach"


def arrays(
    sources: str | tuple[str, ...],
    what: object,
    compute: Callable[[], dict[str, Any]],
    below: str = "",
    most: int | None = None,
) -> dict[str, Any]:
    """What was computed before by the same source files of the same thing, as its repr has it; else it is computed.

    Of those in a folder `below`, at most so many are kept, those computed last.
    """
    files = (sources,) if isinstance(sources, str) else sources
    source = b"".join(Path(file).read_bytes() for file in files)
    with np.printoptions(floatmode="unique"):
        path = cache_folder() / below / f"{hashlib.sha256(source + repr(what).encode()).hexdigest()}.npz"
    if (whole := _read(path)) is not None:
        with np.load(whole) as known:
            return {name: known[name][()] for name in known.files}
    found = compute()
    _write(path, found)
    if most is not None:
        _keep(path.parent, most)
    return found


def _read(path: Path) -> io.BytesIO | None:
    """What `_write` wrote; None where it is not there, or not as it was written."""
    try:
        written = path.read_bytes()
    except OSError:
        return None
    digest, content = written[:_DIGEST], written[_DIGEST:]
    return io.BytesIO(content) if hashlib.sha256(content).digest() == digest else None


def _write(path: Path, found: dict[str, Array]) -> None:
    """Whole, with its digest, or not at all; where the folder cannot be written, the next plan computes it again."""
    content = io.BytesIO()
    np.savez(content, **found)  # type: ignore[arg-type]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(hashlib.sha256(content.getvalue()).digest() + content.getvalue())
        Path(file.name).replace(path)
    except OSError:
        return


def _keep(folder: Path, most: int) -> None:
    """Remove all but the newest of a folder's files."""
    try:
        for file in sorted(folder.glob("*.npz"), key=lambda each: each.stat().st_mtime_ns)[:-most]:
            file.unlink(missing_ok=True)
    except OSError:  # another planner removes them, too
        return
