"""Readers of checked values. Each notes what is wrong and gives a harmless value back, so that all problems are found
in one pass; `Checker.finish` then raises them together."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence

from .yaml_document import DocumentError, Node, Problem

MAX_TEXT = 64
MAX_LISTED = 16
OTHER_UNITS = {"m": ((1e-3, "millimetres"), (1e-2, "centimetres")), "rad": ((math.pi / 180, "degrees"),)}


class Checker:
    """Collects the problems of one file."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.problems: list[Problem] = []

    def note(self, node: Node, expected: str) -> None:
        """The node's value is wrong."""
        self.problems.append(Problem(node.key, node.shown(), expected, node.line))

    def note_at(self, node: Node, key: str, value: str, expected: str) -> None:
        """Something at or below the node is wrong."""
        full = f"{node.key}.{key}" if node.key and key else node.key or key
        self.problems.append(Problem(full, value, expected, node.line))

    def finish(self, error: type[DocumentError]) -> None:
        """Raises `error` if there was any problem, in the order of the file."""
        if self.problems:
            raise error(self.path, sorted(self.problems, key=lambda p: p.line or 0))

    def members(self, node: Node, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Node]:
        """The mapping's nodes by key: unknown keys are noted and left out, missing required ones noted.

        A required key that is there under a misspelt name is noted once, as unknown.
        """
        if not isinstance(node.content, dict):
            self.note(node, f"expected a mapping with {_listed(required or optional)}")
            return {}
        known = [*required, *optional]
        misspelt = set()
        for name, member in node.content.items():
            if name not in known:
                self.note_at(member, "", "", f"unknown key; {did_you_mean(name, known)}")
                misspelt.update(_close(name, known))
        for name in required:
            if name not in node.content and name not in misspelt:
                self.note_at(node, name, "", "is missing")
        return {name: member for name, member in node.content.items() if name in known}

    def items(self, node: Node, most: int) -> list[Node]:
        """The list's nodes."""
        if not isinstance(node.content, list):
            self.note(node, "expected a list: [...]")
            return []
        if len(node.content) > most:
            self.note(node, f"expected at most {most} entries")
            return []
        return node.content

    def text(self, node: Node) -> str:
        """A short, visible text."""
        if isinstance(node.content, str):
            if node.content.isprintable() and node.content.strip() and len(node.content) <= MAX_TEXT:
                return node.content
            self.note(node, f"expected a visible text of 1 to {MAX_TEXT} characters")
        else:
            scalar = not isinstance(node.content, (list, dict)) and node.content is not None
            self.note(node, f'expected a text: "{node.source}"' if scalar else "expected a text")
        return ""

    def choice(self, node: Node, options: Sequence[str]) -> str:
        """One of the words in `options`; the first one after a problem."""
        if isinstance(node.content, str) and node.content in options:
            return node.content
        self.note(node, f"expected {_listed(options, 'or')}")
        return options[0]

    def flag(self, node: Node) -> bool:
        """true or false."""
        if isinstance(node.content, bool):
            return node.content
        self.note(node, "expected true or false")
        return False

    def integer(self, node: Node, low: int, high: int) -> int:
        """A whole number in low..high."""
        if isinstance(node.content, int) and not isinstance(node.content, bool) and low <= node.content <= high:
            return node.content
        self.note(node, f"expected a whole number in {low}..{high}")
        return low

    def number(self, node: Node, low: float, high: float, unit: str = "", above: bool = False) -> float:
        """A finite number in low..high (`above`: greater than low) in `unit`."""
        value = node.content
        bounds = f"in {low:g}..{high:g}" if not above else f"above {low:g} and up to {high:g}"
        expected = f"expected a number {bounds}{' ' + unit if unit else ''}"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            self.note(node, expected)
        elif not math.isfinite(value):
            self.note(node, f"is not a finite number; {expected}")
        elif not low <= value <= high or (above and value == low):
            self.note(node, expected + _magnitude_hint(float(value), low, high, unit))
        else:
            return float(value)
        return low if not above else high

    def numbers(self, node: Node, count: int, low: float, high: float, unit: str = "") -> tuple[float, ...]:
        """A list of exactly `count` numbers, each in low..high; only the first wrong one is noted."""
        if not isinstance(node.content, list) or len(node.content) != count:
            self.note(node, f"expected a list of {count} numbers{' in ' + unit if unit else ''}")
            return (max(low, 0.0),) * count
        before = len(self.problems)
        values = tuple(self.number(item, low, high, unit) for item in node.content)
        del self.problems[before + 1 :]
        return values


def _magnitude_hint(value: float, low: float, high: float, unit: str) -> str:
    """A number that would be right in another unit is most likely written in it."""
    for factor, name in OTHER_UNITS.get(unit, ()):
        if low <= value * factor <= high:
            return f"; looks like {name}: {value * factor:g}?"
    return ""


def _close(name: str, known: Sequence[str]) -> list[str]:
    """The word that was probably meant, or none."""
    return difflib.get_close_matches(name[:MAX_TEXT], known, n=1, cutoff=0.6)


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """A hint at the word that was probably meant."""
    if not known:
        return "none is known here"
    close = _close(name, known)
    return f"did you mean {close[0]}?" if close else f"expected {_listed(known, 'or')}"


def _listed(words: Iterable[str], joint: str = "and") -> str:
    items = list(words)
    if len(items) > MAX_LISTED:
        return f"{', '.join(items[:MAX_LISTED])} {joint} others"
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {joint} {items[-1]}"
