"""`crux completion SHELL`: a script that completes commands, options and file names, made from the parsers."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught

SHELLS = ("bash", "zsh", "fish")


def add_parser(subparsers: Any) -> None:
    """Adds `crux completion`."""
    parser = subparsers.add_parser(
        "completion",
        help="print a script that completes this command in a shell",
        **taught(
            "Prints a script that completes commands, options and file names: read by bash from ~/.bashrc, by zsh as "
            "the file _crux in a folder of fpath, by fish as ~/.config/fish/completions/crux.fish.",
            "crux completion bash >> ~/.bashrc",
            "crux completion fish > ~/.config/fish/completions/crux.fish",
        ),
    )
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or fish")


def run(options: argparse.Namespace) -> int:
    """Exit status 0."""
    import shtab

    from crux_tools.cli import COMMANDS, parser_with

    # Of a command that is not installed there is the name alone.
    here = {name for name, command in COMMANDS.items() if find_spec(command.module.partition(".")[0]) is not None}
    parser = parser_with(here)
    _complete_files(parser, shtab.FILE)
    print(shtab.complete(parser, options.shell))
    return 0


def _complete_files(parser: argparse.ArgumentParser, files: Any) -> None:
    """File names wherever a path is asked for, in the commands below, too."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _complete_files(below, files)
        elif action.type is Path:
            action.complete = files  # type: ignore[attr-defined]
