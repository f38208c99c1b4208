"""`crux key`: the key that an operator signs his commands with."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crux_contracts.terminal import say

from crux_tools.arguments import taught
from crux_tools.output import add_json_option, note, print_json

ROLES = ("operate", "watch")


def add_key_option(parser: argparse.ArgumentParser) -> None:
    """--key FILE, of every command that may have to sign."""
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="your private key (default: ~/.config/crux/operator.pem)"
    )


def add_parser(subparsers: Any) -> None:
    """Adds `crux key new` and `crux key show`."""
    text = (
        "A runtime accepts commands only from keys in its --keys file. Each line of that file has the public half, "
        "operate or watch, and a name. The private half (Ed25519) stays in a file that only you can read; crux upload, "
        "start, hold and the other commands sign with it."
    )
    parser = subparsers.add_parser(
        "key",
        help="manage your signing key",
        **taught(text, "crux key new", "crux key show >> keys", "crux key show --role watch --name wall-display"),
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for name, words in (("new", "make a key"), ("show", "print the line of your key for the runtime's keys file")):
        action = actions.add_parser(name, help=words, **taught(f"{words.capitalize()}.", f"crux key {name}"))
        add_key_option(action)
        action.add_argument(
            "--role",
            choices=ROLES,
            default="operate",
            help="watch: may hold, nothing else; asking needs no key (default: %(default)s)",
        )
        action.add_argument("--name", metavar="NAME", help="what the runtime calls you (default: user@host)")
        add_json_option(action)
    parser.set_defaults(func=run)


def run(options: argparse.Namespace) -> int:
    """Prints the line alone on standard output, so that it can be appended to a file."""
    from crux_tools.operator_key import OperatorKey, checked_name, default_name, default_path

    name = checked_name(default_name() if options.name is None else options.name)
    path = options.key or default_path()
    key = OperatorKey.new(path) if options.action == "new" else OperatorKey(path)
    line = key.line(options.role, name)
    if options.json:
        print_json({"ok": True, "file": str(path), "line": line})
        return 0
    say(line)
    if options.action == "new":
        note(f"your private key is {path}; the line above belongs into the file of crux-runtime --keys FILE")
    return 0
