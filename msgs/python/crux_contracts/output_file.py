"""Files that a command is to write: looked at before its work begins, and written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path


class OutputError(Exception):
    """An output that cannot be what it was asked to be; str() is one line: which option, which path, what is right."""


def look_at_outputs(outputs: Mapping[str, Path | None], inputs: Iterable[Path | None] = ()) -> None:
    """Makes sure that files can be written at the end of the work, and makes the folders they go into.

    `outputs` by the option that names them, `inputs` that must outlive the work; None: not given. Raises OutputError.
    """
    files = {option: path for option, path in outputs.items() if path is not None}
    first: dict[Path, str] = {}
    for option, path in files.items():
        try:
            _look_at(f"{option} {path}", path, [given for given in inputs if given is not None])
            other = first.setdefault(path.resolve(), option)
        except OSError as error:
            raise OutputError(f"{option} {path}: cannot be written: {error.strerror}") from error
        if other != option:
            raise OutputError(f"{option} {path}: is what {other} writes; name another file")


def look_at_folder(option: str, folder: Path) -> None:
    """The same for a folder that takes a command's files. Raises OutputError."""
    try:
        _make_and_try(folder)
    except OSError as error:
        raise OutputError(f"{option} {folder}: no folder that can be written in: {error.strerror}") from error


def _make_and_try(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):  # asks rights, mount and kind of file system at once
        pass


def _look_at(where: str, path: Path, inputs: list[Path]) -> None:
    if path.is_dir():
        raise OutputError(f"{where}: is a folder; name the file to write")
    if path.exists():
        if not path.is_file():
            raise OutputError(f"{where}: is a device or pipe; name a file")
        for given in inputs:
            if given.exists() and path.samefile(given):
                raise OutputError(f"{where}: is the input {given} itself; name another file")
        if not os.access(path, os.W_OK):
            raise OutputError(f"{where}: may not be written")
    _make_and_try(path.resolve().parent)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A file beside `path` for the time of a with-block, in place of `path` where that ends without an exception.

    Through a symbolic link the file behind it is written. Raises OutputError where `path` is no file, OSError where it
    cannot be written.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        raise OutputError(f"{path}: is no regular file; name the file to write")
    with tempfile.NamedTemporaryFile(dir=target.parent, prefix=f".{target.name[:100]}.", delete=False) as file:
        scratch = Path(file.name)
    try:
        yield scratch
        scratch.chmod(0o666 & ~_umask())
        scratch.replace(target)
    except BaseException:
        scratch.unlink(missing_ok=True)
        raise


def write_whole(path: Path, data: bytes) -> None:
    """A broken write leaves an older file as it was. Raises as `whole_file` does."""
    with whole_file(path) as scratch:
        scratch.write_bytes(data)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
