"""The JSON schemas of robot.yaml and of scenarios, for editors, refuse what the readers refuse for one key's sake."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from crux_contracts.robot import ROBOTS
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_contracts.yaml_document import Node, parse_mapping
from crux_tools.paths import ROOT, SCENARIOS, SCHEMAS

TYPES: dict[str, Any] = {
    "number": (int, float),
    "integer": int,
    "string": str,
    "array": list,
    "object": dict,
    "boolean": bool,
}


def wrong(schema: dict[str, Any], value: Any, place: str = "") -> list[str]:
    """Places that a schema refuses, by the keywords that crux's schemas use (JSON Schema draft 7)."""
    kind = schema.get("type")
    if kind and (not isinstance(value, TYPES[kind]) or isinstance(value, bool) != (kind == "boolean")):
        return [place]
    tests: dict[str, Callable[[Any], bool]] = {
        "minimum": lambda least: value >= least,
        "exclusiveMinimum": lambda least: value > least,
        "maximum": lambda most: value <= most,
        "const": lambda only: value == only,
        "enum": lambda choices: value in choices,
        "pattern": lambda form: re.search(form, value) is not None,
        "minLength": lambda least: len(value) >= least,
        "maxLength": lambda most: len(value) <= most,
        "minItems": lambda least: len(value) >= least,
        "maxItems": lambda most: len(value) <= most,
        "minProperties": lambda least: len(value) >= least,
        "maxProperties": lambda most: len(value) <= most,
        "required": lambda keys: set(keys) <= set(value),
        "anyOf": lambda schemas: any(not wrong(each, value) for each in schemas),
    }
    told = {"$schema", "title", "description", "type", "items", "properties", "additionalProperties"}
    assert set(schema) <= told | set(tests), "a keyword that this test does not know"
    found = [place] if not all(tests[word](schema[word]) for word in tests if word in schema) else []
    for index, item in enumerate(value if isinstance(value, list) else []):
        found += wrong(schema.get("items", {}), item, f"{place}[{index}]")
    for key, member in value.items() if isinstance(value, dict) else []:
        known = schema.get("properties", {}).get(key, schema.get("additionalProperties", {}))
        found += [f"{place}.{key}"] if known is False else wrong(known, member, f"{place}.{key}")
    return found


def plain(node: Node) -> Any:
    if isinstance(node.content, dict):
        return {key: plain(member) for key, member in node.content.items()}
    return [plain(item) for item in node.content] if isinstance(node.content, list) else node.content


def read_schema(name: str) -> dict[str, Any]:
    read: dict[str, Any] = json.loads((SCHEMAS / name).read_text(encoding="utf-8"))
    return read


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    return read_schema("robot.json")


@pytest.fixture
def scaler() -> Any:
    path = ROBOTS / "scaler" / "robot.yaml"
    return copy.deepcopy(plain(parse_mapping(path.read_bytes(), str(path))))


def test_the_shipped_robot_is_right(schema: dict[str, Any], scaler: Any) -> None:
    assert wrong(schema, scaler) == []


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("can", "rate_Hz", 0),
        ("can", "rate_Hz", "500"),
        ("can", "watchdog_cycles", 5.5),
        ("can", "nodes", {"joint1": 1}),
        ("servo", "position_gain_Nm_rad", [90, 90]),
        ("gripper", "pad_radius_m", 12),
        ("gripper", "stiffness_N_m", -1),
        ("motor", "pole_pairs", 70),
        ("motor", "gear_efficiency", 1.1),
        ("body", "height_m", [0.1, 0.2, 0.3]),
        ("limb", "joints", ["joint1"]),
        ("limb", "gripper_frame", " "),
        ("limb", "colour", "red"),
    ],
)
def test_a_wrong_value_is_marked(schema: dict[str, Any], scaler: Any, section: str, key: str, value: object) -> None:
    scaler[section][key] = value
    assert any(place.startswith(f".{section}.{key}") for place in wrong(schema, scaler))


def test_a_missing_key_or_another_folder_is_marked(schema: dict[str, Any], scaler: Any) -> None:
    del scaler["control"]["unload_force_N"]
    scaler["urdf"] = "../scaler.urdf"
    scaler["limbs"]["LF"]["bus"] = 16
    assert wrong(schema, scaler) == [".urdf", ".limbs.LF.bus", ".control"]


def test_shipped_scenarios_are_right() -> None:
    schema = read_schema("scenario.json")
    for path in (*SCENARIOS.glob("*.yaml"), ROOT / "examples" / "scenario.yaml"):
        assert wrong(schema, plain(parse_mapping(path.read_bytes(), str(path)))) == [], path


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (["version"], 2),
        (["name"], " "),
        (["wall", "slope_deg"], 200),
        (["contact", "model"], "hook"),
        (["contact", "max_normal_N"], 0),
        (["contact", "spines_only"], {"LF": 3}),
        (["holds", 0, "size_m"], [0.06, 0.06]),
        (["holds", 0, "friction"], {"+x": 1.0}),
        (["holds", 0, "friction"], -1),
        (["holds", 0, "spines"], "no"),
        (["start", "grasps", "LF", "faces"], "z"),
        (["start", "body", "rpy_deg"], [0, 0, 200]),
        (["goal", "body", "tolerance_m"], 0),
        (["horizon", "steps"], 2.5),
        (["planner", "weights", "bodies"], 1),
        (["colour"], "red"),
    ],
)
def test_a_wrong_value_of_a_scenario_is_marked_where_the_reader_refuses_it(keys: list[Any], value: object) -> None:
    path = ROOT / "examples" / "scenario.yaml"
    document = copy.deepcopy(plain(parse_mapping(path.read_bytes(), str(path))))
    parent = document
    for key in keys[:-1]:
        parent = parent[key]
    parent[keys[-1]] = value
    (place, *_) = wrong(read_schema("scenario.json"), document)
    with pytest.raises(ScenarioError):
        parse_scenario(document)
    assert place.startswith("".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys[:2]))
