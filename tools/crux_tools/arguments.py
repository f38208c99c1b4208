"""What the parsers of all commands share: help that teaches by examples, and numbers that are checked at once."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Callable
from typing import Any

WIDTH = 100


def taught(description: str, *examples: str) -> dict[str, Any]:
    """Keywords for `add_parser`: the description, and below the options commands that can be typed as they stand."""
    return {
        "description": textwrap.fill(description, WIDTH),
        "epilog": "\n".join(["example:" if len(examples) == 1 else "examples:", *(f"  {line}" for line in examples)]),
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }


def whole(least: int) -> Callable[[str], int]:
    """The `type` of an option that takes a whole number, `least` or more."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number, {least} or more")
        return value

    return read


def within(low: float, high: float, expected: str) -> Callable[[str], float]:
    """The `type` of an option that takes a finite number from `low` to `high`; `expected` names such a number."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"{text!r}: expected {expected}")
        return value

    return read


def positive(text: str) -> float:
    """The `type` of an option that takes a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number above 0")
    return value
