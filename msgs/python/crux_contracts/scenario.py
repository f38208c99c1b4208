"""A scenario: the wall, the contact model, holds, start, goal and horizon. Frame W: z off the wall, x up the slope.

`load_scenario` and `parse_scenario` read YAML, the latter dicts as well, and raise ScenarioError for anything that is
not right. Reach, equilibrium and finger widths need the robot's kinematics: the planner judges them.

examples/scenario.yaml has every key with its meaning and default.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from .scenario_reader import read_scenario
from .scenario_types import *  # noqa: F403
from .scenario_types import Scenario, ScenarioError
from .yaml_document import DocumentError, read_bytes


def load_scenario(path: str | Path) -> Scenario:
    """Reads and validates a scenario file. Raises ScenarioError."""
    try:
        data = read_bytes(Path(path))
    except DocumentError as error:
        raise ScenarioError(error.path, error.problems) from None
    return parse_scenario(data, str(path))


def parse_scenario(
    source: str | bytes | Mapping[str, object], path: str = "scenario", any_robot: bool = False
) -> Scenario:
    """Validates a scenario given as YAML text or as a dict with the same keys, whose values may be NumPy's numbers and
    arrays; `path` names it in messages. `any_robot`: that of a log, which brings its robot's description along, may
    have one that is not described here. Raises ScenarioError.
    """
    if isinstance(source, Mapping):
        from .yaml_writer import as_yaml

        try:
            return read_scenario(as_yaml(source, path).encode(), path, any_robot)
        except DocumentError as error:  # less the lines of a text that the caller has not seen
            raise ScenarioError(path, [replace(problem, line=None) for problem in error.problems]) from None
    data = source if isinstance(source, bytes) else source.encode("utf-8", errors="surrogatepass")
    return read_scenario(data, path, any_robot)
