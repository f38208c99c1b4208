"""What several of the planner's tests share."""

from __future__ import annotations

import pytest
from crux_contracts.robot import Robot, load_robot


@pytest.fixture(scope="session")
def robot() -> Robot:
    """The simulated robot."""
    return load_robot("scaler")
