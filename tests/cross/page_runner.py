"""Runs `crux` commands one after the other as after `make climb`: with the Python packages of that level alone.

python page_runner.py TASKS.json: a list of [words, output file or ""], run in the present folder; prints a list of
[exit status, standard error]. A page that a command serves is asked for once, then the command is ended as by Ctrl-C.
"""

from __future__ import annotations

import contextlib
import importlib.abc
import importlib.metadata
import io
import json
import re
import sys
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
LOCKS = ("operator.lock", "simulation.lock")  # what `make climb` installs


def _locked() -> set[str]:
    texts = [(ROOT / "tools" / "setup" / lock).read_text(encoding="utf-8") for lock in LOCKS]
    return {name for text in texts for name in re.findall(r"^([a-z0-9-]+)==", text, re.MULTILINE)}


class LaterLevels(importlib.abc.MetaPathFinder):
    """Modules of installed packages that `make climb` does not install are not there."""

    def __init__(self) -> None:
        def normal(name: str) -> str:
            return re.sub(r"[-_.]+", "-", name).lower()

        here = importlib.metadata.packages_distributions()
        locked = _locked()
        self.modules = {module for module, owners in here.items() if not locked & {normal(owner) for owner in owners}}

    def find_spec(self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None) -> None:
        """Refuses them; leaves all others to the usual finders."""
        if name.partition(".")[0] in self.modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def _run(words: list[str], output: str) -> tuple[int, str]:
    from crux_tools import cli

    told, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(said):
        try:
            status = cli.main(words)
        except SystemExit as ended:
            status = int(ended.code or 0)
    if output:
        Path(output).write_text(told.getvalue(), encoding="utf-8")
    return status, said.getvalue()


def main(tasks: Path) -> None:
    sys.meta_path.insert(0, LaterLevels())
    from crux_tools.view.server import Viewer

    def asked_once(viewer: Viewer) -> None:
        with urllib.request.urlopen(viewer.url, timeout=60) as answer:
            assert b"<canvas" in answer.read()
        raise KeyboardInterrupt

    Viewer.wait = asked_once  # type: ignore[method-assign,assignment]
    json.dump([_run(words, output) for words, output in json.loads(tasks.read_text())], sys.stdout)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
