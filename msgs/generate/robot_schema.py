"""JSON schema of robot.yaml, by which editors complete and check it."""

from __future__ import annotations

import json
from typing import Any

from crux_contracts import LIMB_NAMES, records
from crux_contracts.robot_bounds import JOINTS, LEAST_JOINTS, MOST_JOINTS

from .record_schema import DRAFT, TEXT, described, listed, mapping
from .robot_keys import Key, RobotKeys

_TYPES: dict[str, Any] = {"number": float, "integer": int, "interval": tuple[float, float], "text": str}
_TYPES["per_joint"] = tuple[float, ...]
_EACH_JOINT = {"minItems": LEAST_JOINTS, "maxItems": MOST_JOINTS}


def schema(keys: RobotKeys) -> str:
    """robot.json."""
    limb = _mapping("of this limb", keys.names["limbs"])
    top = {key.name: _value(key) for key in keys.names[""]}
    top["limbs"] = mapping("bus and prefix of each limb", dict.fromkeys(LIMB_NAMES, limb))
    top["limb"] = _mapping("names in the URDF", keys.names["limb"])
    for section in keys.sections:
        top[section.name] = _mapping(section.means, section.all_keys)
    required = [name for name in top if name not in {section.name for section in keys.sections if section.optional}]
    head = {"$schema": DRAFT, "title": "robot.yaml of crux"}
    return json.dumps(head | mapping("a robot that crux plans for and controls", top, required), indent=1) + "\n"


def _mapping(means: str, keys: tuple[Key, ...]) -> dict[str, Any]:
    required = [key.name for key in keys if key.default is None]
    return mapping(means, {key.name: _value(key) for key in keys}, required)


def _value(key: Key) -> dict[str, Any]:
    if key.type in _TYPES:
        found = described(records.Key(key.low, key.high, key.unit, key.means, type=_TYPES[key.type]))
        return found | _EACH_JOINT if key.type == "per_joint" else found
    forms: dict[str, dict[str, Any]] = {
        "file": TEXT | {"pattern": r"^(?!\.\.?$)[^/]*[^/\s][^/]*$"},
        "names": listed(TEXT, key.count) if key.count else {"type": "array", "items": TEXT, **_EACH_JOINT},
        "nodes": {
            "type": "object",
            "properties": {"gripper": {"const": JOINTS + 1}},
            "required": ["gripper"],
            "additionalProperties": {"enum": [n for n in range(1, MOST_JOINTS + 2) if n != JOINTS + 1]},
            "minProperties": LEAST_JOINTS + 1,
            "maxProperties": MOST_JOINTS + 1,
        },
    }
    return {"description": key.means, **forms[key.type]}
