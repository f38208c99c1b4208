"""`--help` works with what `make climb` installs, and a command that needs more says how to get it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

from crux_tools.paths import ROOT

FIRST_LEVEL = ("operator.lock", "simulation.lock")
# Stands before a program: imports of packages that the locks of the first level do not name fail.
BLOCKER = """
import importlib.abc, importlib.metadata, json, re, sys
allowed = set(json.loads(sys.argv.pop(1)))
owners = {name: {re.sub("[-_.]+", "-", each).lower() for each in found}
          for name, found in importlib.metadata.packages_distributions().items()}
class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in owners and not owners[top] & allowed:
            raise ModuleNotFoundError(f"No module named {top!r}", name=top)
sys.meta_path.insert(0, Blocker())
"""
EVERY_HELP = """
import argparse, contextlib, io
from crux_tools import cli
def paths(parser, before=()):
    yield before
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from paths(below, (*before, name))
shown = {}
for words in paths(cli.parser_with(cli.COMMANDS)):
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            status = cli.main([*words, "--help"])
        except SystemExit as stopped:
            status = stopped.code
    if status or "usage: " not in out.getvalue():
        print("crux", *words, "--help:", out.getvalue())
    shown[words] = status
print(len(shown), "shown")
"""
COMMANDS = """
import json, sys
from crux_tools.cli import main
print([main(words) for words in json.loads(sys.argv[1])])
"""


def first_level(program: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs Python code in an interpreter that has only what `make climb` installs."""
    locks = "\n".join((ROOT / "tools" / "setup" / lock).read_text(encoding="utf-8") for lock in FIRST_LEVEL)
    allowed = json.dumps(re.findall(r"^([\w.-]+)==", locks, re.MULTILINE))
    command = [sys.executable, "-c", BLOCKER + program, allowed, *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_every_command_shows_its_help() -> None:
    done = first_level(EVERY_HELP)
    assert done.returncode == 0, done.stderr
    (last,) = done.stdout.splitlines()[-1:]
    assert done.stdout == f"{last}\n"
    assert int(last.removesuffix(" shown")) > 60


def test_the_blocker_blocks() -> None:
    done = first_level("import numpy, mujoco\nimport psutil")
    assert done.stderr.endswith("ModuleNotFoundError: No module named 'psutil'\n")


def test_a_command_that_needs_more_names_the_least_that_installs_it(tmp_path: Path, log_path: Path) -> None:
    spec = ROOT / "examples" / "four-hold-walls.yaml"
    commands = [
        ["log", "export", log_path, "--csv", "-o", tmp_path / "tables"],
        ["campaign", spec, "--out", tmp_path / "out"],
        ["log", "export", log_path, "--rerun", "-o", tmp_path / "log.rrd"],
    ]
    done = first_level(COMMANDS, json.dumps(commands, default=str))
    assert done.stdout == "[2, 2, 2]\n"
    assert done.stderr.splitlines() == [
        "crux log: needs pyarrow, which is not installed: make extras",
        "crux campaign: needs dask, which is not installed: make extras",
        "crux log: needs rerun, which is not installed: make setup",
    ]
