"""JSON schema of a file that dataclasses describe (crux_contracts.records), by which editors complete and check it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import is_dataclass, replace
from typing import Any, get_args

from crux_contracts.reading import MAX_TEXT
from crux_contracts.records import Key, keys_of
from crux_contracts.scenario_types import FACE_NAMES, Standing

DRAFT = "http://json-schema.org/draft-07/schema#"
TEXT = {"type": "string", "minLength": 1, "maxLength": MAX_TEXT, "pattern": r"\S"}


def schema(keys: dict[str, Key], title: str, version: int) -> str:
    """Of a file with a version at its top."""
    top = _record(title, keys)
    top["properties"]["version"] = {"const": version}
    top["required"].insert(0, "version")
    if "footholds" in keys:
        for part in ("start", "goal"):
            _or_standing(top["properties"][part]["properties"]["grasps"])
    return json.dumps({"$schema": DRAFT, "title": title} | top, indent=1) + "\n"


def _or_standing(grasps: dict[str, Any]) -> None:
    """Lets limbs stand in place of a grasp."""
    standing = _of_kind(Standing)
    grasps["properties"] = {
        limb: {name: value for name, value in grasp.items() if name != "required"}
        | {
            "properties": grasp["properties"] | standing["properties"],
            "anyOf": [{"required": grasp["required"]}, {"required": standing["required"]}],
        }
        for limb, grasp in grasps["properties"].items()
    }


def _of_kind(kind: Any) -> dict[str, Any]:
    return _record(kind.__doc__ or "", keys_of(kind))


def _record(means: str, keys: dict[str, Key]) -> dict[str, Any]:
    required = [name for name, key in keys.items() if key.required]
    return mapping(means, {name: described(key) for name, key in keys.items()}, required)


def described(key: Key) -> dict[str, Any]:
    return {**_value(key), "description": f"{key.means} [{key.unit}]" if key.unit else key.means}


def _value(key: Key) -> dict[str, Any]:
    least = {"exclusiveMinimum" if key.above else "minimum": key.low} if math.isfinite(key.low) else {}
    bounds = least | ({"maximum": key.high} if math.isfinite(key.high) else {})
    parts = [part for part in get_args(key.type) if part not in (type(None), ...)]
    kinds = {float: "number", int: "integer", bool: "boolean"}
    if key.reader in ("friction", "spines"):  # one for all faces, or by face
        each = _value(replace(key, reader="", type=parts[0]))
        faces = list(FACE_NAMES) if key.required else []
        return {"anyOf": [each, mapping("by face", dict.fromkeys(FACE_NAMES, each), faces)]}
    if key.reader == "pads":  # one for both, or one each
        return {"anyOf": [each := {"type": "number", **bounds}, listed(each, 2)]}
    if key.type in kinds:
        return {"type": kinds[key.type], **bounds}
    if key.type is str:
        return {"enum": list(key.words)} if key.words else TEXT
    if is_dataclass(key.type):
        return _of_kind(key.type)
    each = _value(replace(key, type=parts[-1], words=key.words if parts[0] is str and len(parts) == 1 else ()))
    if type(None) in get_args(key.type):
        return each
    if key.type.__origin__ is dict:
        return mapping("by name", dict.fromkeys(key.words, each), [])
    count = {"maxItems": key.most} if key.most else {}
    some = count or ... in get_args(key.type)
    return {"type": "array", "items": each} | count if some else listed(each, len(parts))


def mapping(means: str, members: dict[str, Any], required: Sequence[str] | None = None) -> dict[str, Any]:
    """All members have to be there, or the required ones."""
    return {
        "description": means,
        "type": "object",
        "properties": members,
        "required": list(members if required is None else required),
        "additionalProperties": False,
    }


def listed(items: dict[str, Any], count: int) -> dict[str, Any]:
    """So many."""
    return {"type": "array", "items": items, "minItems": count, "maxItems": count}
