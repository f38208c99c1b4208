"""The robot `limbero` that ships, whose limbs have four joints: its scene is planned, checked, climbed and replayed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from climbs import climbs_and_replays
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_tools import cli
from crux_tools.paths import ROOT
from shared_plans import unproven


@pytest.mark.parametrize("slope_deg", [45, pytest.param(90, marks=pytest.mark.sweep)])
def test_it_climbs_its_wall(slope_deg: int, tmp_path: Path) -> None:
    """Some 15 s: the reach of its limbs is mapped, and the climb takes a minute. As steep as the page says."""
    robot, log = load_robot("limbero"), tmp_path / "log.mcap"
    assert [len(limb.joints) for limb in robot.limbs] == [4] * 4
    text = (ROOT / "msgs" / "scenarios" / "climb-limbero.yaml").read_text(encoding="utf-8")
    assert "slope_deg: 45}" in text
    found = unproven(parse_scenario(text.replace("slope_deg: 45}", f"slope_deg: {slope_deg}}}")), robot)
    climbs_and_replays(found, robot, log)


def test_the_check_says_where_plans_keep_its_elbows(capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["robot", "check", "limbero", "--json"])
    checks = {check["topic"]: check for check in json.loads(capsys.readouterr().out)["checks"]}
    assert "-0.4..2.95" in checks["limits"]["found"]
    assert "planned within LF_F2T 0.265..2.95 rad" in checks["limits"]["found"]
