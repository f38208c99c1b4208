"""One good plan for everything that breaks plans."""

from __future__ import annotations

from pathlib import Path

import pytest
from broken_scenarios import SCENARIO
from shared_plans import SharedPlans


@pytest.fixture(scope="session")
def plan_path(planned: SharedPlans, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plan of the four-hold wall, made by the real planner."""
    path = tmp_path_factory.mktemp("plan") / "plan.mcap"
    planned.write(SCENARIO.stem, path)
    return path
