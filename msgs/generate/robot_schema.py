"""JSON schema of robot.yaml, by which editors complete and check it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.reading import MAX_TEXT
from crux_contracts.robot_bounds import JOINTS

from .robot_keys import Key, RobotKeys

TEXT = {"type": "string", "minLength": 1, "maxLength": MAX_TEXT, "pattern": r"\S"}


def schema(keys: RobotKeys) -> str:
    """robot.json."""
    limb = mapping("of this limb", {key.name: _value(key) for key in keys.names["limbs"]})
    top = {key.name: _value(key) for key in keys.names[""]}
    top["limbs"] = mapping("bus and prefix of each limb", dict.fromkeys(LIMB_NAMES, limb))
    top["limb"] = mapping("names in the URDF", {key.name: _value(key) for key in keys.names["limb"]})
    for section in keys.sections:
        top[section.name] = mapping(section.means, {key.name: _value(key) for key in section.all_keys})
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": "robot.yaml of crux"}
    return json.dumps(head | mapping("a robot that crux plans for and controls", top), indent=1) + "\n"


def mapping(means: str, members: dict[str, Any], required: Sequence[str] | None = None) -> dict[str, Any]:
    """All members have to be there, or the required ones."""
    return {
        "description": means,
        "type": "object",
        "properties": members,
        "required": list(members if required is None else required),
        "additionalProperties": False,
    }


def _value(key: Key) -> dict[str, Any]:
    bounds = {"minimum": key.low, "maximum": key.high}
    number = {"type": "number", **bounds}
    forms: dict[str, dict[str, Any]] = {
        "number": number,
        "integer": {"type": "integer", **bounds},
        "per_joint": listed(number, key.count),
        "interval": listed(number, key.count),
        "text": TEXT,
        "file": TEXT | {"pattern": r"^(?!\.\.?$)[^/]*[^/\s][^/]*$"},
        "names": listed(TEXT, key.count),
        "nodes": {
            "type": "object",
            "properties": {"gripper": {"const": JOINTS + 1}},
            "required": ["gripper"],
            "additionalProperties": {"enum": list(range(1, JOINTS + 1))},
            "minProperties": JOINTS + 1,
            "maxProperties": JOINTS + 1,
        },
    }
    return {"description": f"{key.means} [{key.unit}]" if key.unit else key.means, **forms[key.type]}


def listed(items: dict[str, Any], count: int) -> dict[str, Any]:
    return {"type": "array", "items": items, "minItems": count, "maxItems": count}
