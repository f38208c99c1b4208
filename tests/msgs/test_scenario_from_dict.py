"""Scenarios made in Python: the same as from YAML, whatever numbers they are made of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_contracts.yaml_document import parse_mapping, values
from crux_contracts.yaml_writer import as_yaml
from crux_tools.paths import SCENARIOS
from hypothesis import given
from hypothesis import strategies as st

ONE_STEP = (SCENARIOS / "climb-one-step.yaml").read_text(encoding="utf-8")


def numpy_numbers(value: Any) -> Any:
    """The same with NumPy's numbers, and an array wherever a list has numbers alone."""
    if isinstance(value, dict):
        return {key: numpy_numbers(member) for key, member in value.items()}
    if isinstance(value, list):
        return np.array(value) if isinstance(value[0], float) else tuple(numpy_numbers(item) for item in value)
    kinds: dict[type, Any] = {int: np.int64, float: np.float64, bool: np.bool_, str: np.str_}
    return kinds[type(value)](value)


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_dict_is_the_same_scenario_as_its_yaml(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for content in (yaml.safe_load(text), numpy_numbers(yaml.safe_load(text))):
        made = parse_scenario(content, path="a wall")
        assert replace(made, yaml_text=text) == parse_scenario(text, path="a wall")
        assert parse_scenario(made.yaml_text, path="a wall") == made


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**17), 10**17) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@given(st.dictionaries(st.text(), PLAIN, min_size=1))
def test_what_is_written_is_read_again(content: dict[str, Any]) -> None:
    assert values(parse_mapping(as_yaml(content, "it").encode(), "it")) == content


def test_words_of_yaml_1_1_and_lists_in_several_places() -> None:
    size = [0.1, 0.2]
    content = {"name": "1e3", "holds": ["yes", "on", "1:30", "null", "0x10", "1_000"], "a": size, "b": size}
    assert values(parse_mapping(as_yaml(content, "it").encode(), "it")) == content


LOOP: dict[str, Any] = {}
LOOP["it"] = LOOP


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ({1, 2}, "goal.body.position_m: set {1, 2}: expected a text, a number, true or false, a list, an array or"),
        (np.zeros((2, 2)), "goal.body.position_m: a list of 2: expected a list of 3 numbers in m"),
        (np.array([0.0, np.nan, 0.2]), "goal.body.position_m[1]: .nan: is not a finite number"),
        (np.array([0.0, 0.0, 1j]), "goal.body.position_m[0]: complex 0j: expected a text, a number"),
        ({3: 1.0}, "goal.body.position_m: 3: expected a text as key"),
        ("\ud800", "cannot be written as YAML: 'utf-8' codec can't encode"),
        (10**5000, "cannot be written as YAML: Exceeds the limit"),
        (LOOP, "nested deeper than 16 levels"),
    ],
    ids=["set", "shape", "nan", "complex", "key", "surrogate", "digits", "loop"],
)
def test_one_clear_line_for_a_wrong_value(value: object, says: str) -> None:
    content = yaml.safe_load(ONE_STEP)
    content["goal"]["body"]["position_m"] = value
    with pytest.raises(ScenarioError) as error:
        parse_scenario(content, path="my wall")
    assert says in str(error.value)
    assert str(error.value).startswith("my wall: ")  # and no line of a text that was never written down
    assert len(str(error.value).splitlines()) == 1
