"""A folder for this user's locks that nobody else can prepare: links and other people's folders are refused."""

import contextlib
import os
import stat
import tempfile
from pathlib import Path

from crux_tools.errors import UsageError


def private_folder() -> Path:
    """`crux` in $XDG_RUNTIME_DIR, or `crux-UID` in the temporary folder; made where it is missing, for its user alone.

    Raises UsageError where something else is there.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    own = bool(runtime) and _is_own(Path(runtime or ""))
    folder = Path(runtime or "") / "crux" if own else Path(tempfile.gettempdir()) / f"crux-{os.getuid()}"
    with contextlib.suppress(OSError):  # what is there instead is looked at below
        folder.mkdir(mode=0o700)
    if not _is_own(folder):
        expected = f"expected a folder of user {os.getuid()} that nobody else can read or write"
        raise UsageError(f"{folder}: {expected}; remove what is there, or set TMPDIR to another folder")
    return folder


def _is_own(folder: Path) -> bool:
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
