"""The margins a report draws are those the checker found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.plan_file import read_plan
from crux_tools import cli
from crux_tools.telemetry.margins import planned_margin_n
from shared_plans import SharedPlans


@pytest.fixture(scope="module")
def walk_path(tmp_path_factory: pytest.TempPathFactory, planned: SharedPlans) -> Path:
    """A plan with feet on the ground instead of grippers on holds."""
    path = tmp_path_factory.mktemp("walk") / "walk.mcap"
    planned.write("walk-flat", path)
    return path


@pytest.mark.parametrize("name", ["plan_path", "walk_path"])
def test_smallest_margin(name: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> None:
    path: Path = request.getfixturevalue(name)
    capsys.readouterr()
    assert cli.main(["check", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["min_margin"]["friction"]
    assert float(np.nanmin(planned_margin_n(read_plan(path)))) == pytest.approx(found, abs=1e-6)
