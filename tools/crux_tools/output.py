"""What every command of crux shares: --json, results on standard output, everything else on standard error."""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from crux_contracts.terminal import say

from crux_tools.errors import UsageError
from crux_tools.private_folder import private_folder


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """--json: one object on standard output, nothing else there."""
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object on standard output")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None  # JSON has no NaN
    return value


def print_json(result: dict[str, Any]) -> None:
    """One object, one line."""
    print(json.dumps(_finite(result), default=float))


def note(text: str) -> None:
    """A line for the person at the terminal, on standard error."""
    say(text, to_errors=True)


@contextmanager
def alone_with(path: Path) -> Iterator[None]:
    """Holds an output for the time of a with-block; raises UsageError where another command of this user does."""
    name = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:16]
    with (private_folder() / f"output-{name}.lock").open("w") as lock:
        try:  # the file stays: unlinking a locked file would let a third command lock its successor
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(f"{path}: another command is writing it; wait for it, or name another file") from None
        yield


class Progress:
    """A progress bar on standard error when that is a terminal; silent otherwise."""

    def __init__(self, text: str, total: float) -> None:
        self._bar: Any = None
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
            self._bar = Bar(*columns, console=Console(stderr=True), transient=True)
            self._task = self._bar.add_task(text, total=total)
            self._bar.start()

    def at(self, done: float) -> None:
        """Sets the work done so far, in the unit of `total`."""
        if self._bar is not None:
            self._bar.update(self._task, completed=done)

    def end(self) -> None:
        """Takes the bar away."""
        if self._bar is not None:
            self._bar.stop()


@contextmanager
def progress(text: str, total: float) -> Iterator[Progress]:
    """A progress bar for the time of a with-block."""
    bar = Progress(text, total)
    try:
        yield bar
    finally:
        bar.end()
