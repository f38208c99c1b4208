"""Text for a terminal. What came over the network or out of a file may hold signs that command the terminal."""

from __future__ import annotations

import sys
import unicodedata

BREAKS = "\n\t"
COMMANDS = ("Cc", "Cf", "Zl", "Zp")  # Unicode: controls, signs that turn or hide text, separators of lines


def plain(text: str) -> str:
    """`text` with every sign that commands a terminal written as an escape, as in Python; line breaks and tabs stay."""
    return "".join(_shown(sign) for sign in text)


def in_a_line(text: str) -> str:
    """The same with line breaks and tabs escaped as well: what somebody else has written looks like no line of ours."""
    return "".join(repr(sign)[1:-1] if sign in BREAKS else _shown(sign) for sign in text)


def say(text: str, *, to_errors: bool = False) -> None:
    """A line for the person at the terminal, on standard output or standard error."""
    print(plain(text), file=sys.stderr if to_errors else sys.stdout, flush=to_errors)


def _shown(sign: str) -> str:
    if sign.isprintable() or sign in BREAKS or unicodedata.category(sign) not in COMMANDS:
        return sign
    return sign.encode("unicode_escape").decode()
