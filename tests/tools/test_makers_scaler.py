"""The robot `scaler-makers` that ships: what its makers' URDF and the mapping beside it make, and a climb of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from crux_contracts.robot import ROBOTS, load_robot
from crux_contracts.scenario import load_scenario
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_tools import cli
from crux_tools.paths import ROOT
from shared_plans import unproven

MAKERS, NAME = ROOT / "examples" / "makers-scaler", "scaler-makers"


def test_it_is_what_import_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mapping = tmp_path / "mapping.yaml"
    text = (MAKERS / "mapping.yaml").read_text(encoding="utf-8")
    mapping.write_text(text.replace("name: makers\n", f"name: {NAME}\n"), encoding="utf-8")
    words = ["robot", "import", str(MAKERS / "scaler.urdf"), "--mapping", str(mapping), "-o", str(tmp_path / NAME)]
    assert cli.main(words) == 0
    capsys.readouterr()
    for name in ("robot.yaml", f"{NAME}.urdf"):
        assert (ROBOTS / NAME / name).read_bytes() == (tmp_path / NAME / name).read_bytes()


def test_it_climbs_one_step_of_its_wall(tmp_path: Path) -> None:
    """Planned, checked, climbed, and computed again from the log."""
    robot, log = load_robot(NAME), tmp_path / "log.mcap"
    assert robot.limbs[0].transmission.five_bar is not None
    found = unproven(load_scenario(ROOT / "msgs" / "scenarios" / "climb-makers.yaml"), robot)
    assert found.check.violations == []
    result = climb(found.plan, robot, log, ClimbOptions())
    assert result.ok, result.reason
    assert result.verdict.slips == 0
    assert result.verdict.goal_error_m < 0.02
    assert cli.main(["replay", str(log), "--check", "--no-view"]) == 0
