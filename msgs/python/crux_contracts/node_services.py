"""Numbers of the services that nodes offer over ISO-TP (msgs/can/services.yaml)."""

from __future__ import annotations

from functools import cache
from typing import Any

import yaml

from .places import MSGS

NUMBERS = MSGS / "can" / "services.yaml"
GROUPS = ("service", "refusal", "data", "routine", "flag", "acknowledgement")


@cache
def _document() -> dict[str, dict[str, Any]]:
    document: dict[str, dict[str, Any]] = yaml.safe_load(NUMBERS.read_text(encoding="utf-8"))
    return document


def numbers() -> dict[str, dict[str, int]]:
    """Name to number in each of GROUPS."""
    return {group: _document()[group] for group in GROUPS}


def number(group: str, name: str) -> int:
    """Of a service, data identifier, routine, …"""
    return int(_document()[group][name])


def refusal(code: int) -> str:
    """What a negative response code means, in words."""
    names = {value: name for name, value in _document()["refusal"].items()}
    means = _document()["refusal_means"]
    return str(means[names[code]]) if names.get(code) in means else f"reason 0x{code:02X}"
