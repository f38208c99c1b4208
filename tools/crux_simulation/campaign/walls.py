"""Walls of a campaign: drawn by a generator from a seed, or a scenario file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import yaml
from crux_contracts.scenario_document import scenario_document

from crux_simulation.benchmarks.pairs import walking_pair
from crux_simulation.benchmarks.random_fields import random_field
from crux_simulation.benchmarks.random_planes import random_planes
from crux_simulation.benchmarks.random_walls import random_ladder, random_wall

GENERATORS: dict[str, Callable[..., str]] = {
    "wall": random_wall,
    "ladder": random_ladder,
    "field": random_field,
    "planes": random_planes,
    "walk": walking_pair,
}
"""By kind: (seed, **settings) -> scenario as YAML text."""


@dataclass(frozen=True)
class Wall:
    """One wall. `settings` are the generator's own beside the seed; a scenario file has its `text`, and no kind."""

    kind: str = ""
    seed: int = 0
    settings: tuple[tuple[str, Any], ...] = ()
    text: str = ""

    def scenario(self) -> str:
        """As YAML text; the same every time."""
        return self.text or GENERATORS[self.kind](self.seed, **dict(self.settings))

    def planned(self, **planner: Any) -> Wall:
        """The same wall with these keys of the scenario's `planner`; what is None stays as the wall has it."""
        asked = {key: value for key, value in planner.items() if value is not None}
        if not asked:
            return self
        content = scenario_document(self.scenario())
        content["planner"] = {**content.get("planner", {}), **asked}
        return Wall(seed=self.seed, text=yaml.safe_dump(content, sort_keys=False))
