"""Whatever becomes of a scenario's text, it is read or refused with a message."""

from __future__ import annotations

import copy
from typing import Any

import yaml
from crux_contracts.scenario import Scenario, ScenarioError, parse_scenario
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_texts import GOOD_TEXT


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(deeper for key, child in children for deeper in _paths(child, (*path, key)))]


GOOD = yaml.safe_load(GOOD_TEXT)
ODD_VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
    st.lists(st.integers(), max_size=4),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=3),
    st.sampled_from(["x", "a", "+x", "patch", "LF", {}]),
)


@settings(deadline=None, max_examples=400)
@given(data=st.data())
def test_any_change_of_a_good_scenario_loads_or_tells(data: st.DataObject) -> None:
    document = copy.deepcopy(GOOD)
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(_paths(document)[1:]))
        parent = document
        for step in path[:-1]:
            parent = parent[step]
        action = data.draw(st.sampled_from(["delete", "replace", "rename"]))
        if action == "delete":
            del parent[path[-1]]
        elif action == "replace" or isinstance(parent, list):
            parent[path[-1]] = data.draw(ODD_VALUES)
        else:
            parent[data.draw(st.text(max_size=12))] = parent.pop(path[-1])
        if not isinstance(document, dict) or not document:
            break
    _loads_or_tells(yaml.safe_dump(document, allow_unicode=True))


@settings(deadline=None, max_examples=300)
@given(data=st.data())
def test_any_change_of_the_bytes_loads_or_tells(data: st.DataObject) -> None:
    text = bytearray(GOOD_TEXT.encode())
    for _ in range(data.draw(st.integers(1, 8))):
        start = data.draw(st.integers(0, len(text)))
        text[start : start + data.draw(st.integers(0, 6))] = data.draw(st.binary(max_size=6))
    _loads_or_tells(bytes(text))


def _loads_or_tells(source: str | bytes) -> None:
    try:
        assert isinstance(parse_scenario(source, "s.yaml"), Scenario)
    except ScenarioError as error:
        text = str(error)
        assert text.startswith("s.yaml")
        assert len(text.splitlines()) <= 21
