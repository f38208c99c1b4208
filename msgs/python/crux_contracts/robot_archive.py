"""A robot's folder in an archive: unpacked into a folder of this process, once while the archive stays the same."""

from __future__ import annotations

import lzma
import re
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath

from .yaml_document import DocumentError, Problem

ENDINGS = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.xz")
MOST_FILES, MOST_BYTES = 1000, 256 * 1024 * 1024  # of a robot with its meshes
_KEPT: dict[tuple[str, int, int], tuple[tempfile.TemporaryDirectory[str], Path]] = {}

_UNREADABLE = (
    *(OSError, EOFError, ValueError),
    RuntimeError,  # encrypted, or compressed in a way that zipfile does not know
    *(zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError),
)
_Entry = tuple[str, int, Callable[[], bytes]]
"""Of a file: its name, how many bytes it has, and what reads them."""


def is_archive(path: Path) -> bool:
    """Whether a file is one by its name."""
    return path.name.lower().endswith(ENDINGS) and path.is_file()


def unpacked(archive: Path) -> Path:
    """The robot's folder: that which has robot.yaml; the archive's top has the name that robot.yaml says. Raises
    DocumentError where there is none, more than one, or what no robot has.
    """
    about = archive.stat()
    key = str(archive.resolve()), about.st_mtime_ns, about.st_size
    if key not in _KEPT:
        try:
            with _entries(archive) as entries:
                _KEPT[key] = _written(archive, entries)
        except _UNREADABLE as error:
            raise _refused(archive, "", f"cannot be read: {error}") from error
    return _KEPT[key][1]


@contextmanager
def _entries(archive: Path) -> Iterator[Iterator[_Entry]]:
    """Its files; links and devices are left out."""
    if archive.name.lower().endswith(".zip"):
        with zipfile.ZipFile(archive) as opened:
            infos = (info for info in opened.infolist() if not info.is_dir())
            yield ((info.filename, info.file_size, partial(opened.read, info)) for info in infos)
        return
    with tarfile.open(archive) as opened_tar:
        members = (member for member in opened_tar if member.isfile())
        yield ((member.name, member.size, partial(_content, opened_tar, member)) for member in members)


def _content(opened: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    stream = opened.extractfile(member)
    return b"" if stream is None else stream.read()


def _bounded(archive: Path, entries: Iterator[_Entry]) -> list[tuple[PurePosixPath, Callable[[], bytes]]]:
    """The same where they are no more, and no more bytes, than a robot has, and lead nowhere else."""
    found: list[tuple[PurePosixPath, Callable[[], bytes]]] = []
    total = 0
    for name, size, read in entries:
        total += size
        if len(found) == MOST_FILES or total > MOST_BYTES:
            expected = f"expected a robot's folder, of at most {MOST_FILES} files and {MOST_BYTES >> 20} MiB"
            raise _refused(archive, "more", expected)
        inner = PurePosixPath(name)
        if ".." in inner.parts or inner.is_absolute():
            raise _refused(archive, name, "expected names inside the archive")
        found.append((inner, read))
    return found


def _written(archive: Path, entries: Iterator[_Entry]) -> tuple[tempfile.TemporaryDirectory[str], Path]:
    files = _bounded(archive, entries)
    robots = [(inner.parent, read) for inner, read in files if inner.name == "robot.yaml"]
    if len(robots) != 1:
        raise _refused(archive, f"{len(robots)} files robot.yaml", "expected one, with the robot's URDF beside it")
    (top, description), kept = robots[0], tempfile.TemporaryDirectory(prefix="crux-robot-")
    named = re.search(rb"^name: *([A-Za-z0-9_-]+)", description(), re.MULTILINE)
    folder = Path(kept.name) / (top.name or (named[1].decode() if named else "robot"))
    for inner, read in files:
        if inner.is_relative_to(top):
            path = folder / inner.relative_to(top)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(read())
    return kept, folder


def _refused(archive: Path, value: str, expected: str) -> DocumentError:
    return DocumentError(str(archive), [Problem("", value, expected)])
