"""The robot `scaler-makers` that ships: what its makers' URDF and the mapping beside it make, and a climb of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from climbs import climbs_and_replays
from crux_contracts.robot import ROBOTS, load_robot
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_tools import cli
from crux_tools.paths import ROOT
from crux_tools.robot3d.robot_model import build_model
from crux_tools.view.bodies import Bodies
from hand_plan import standing_plan
from shared_plans import unproven

TELEOPERATED = """
limits_rad: {Shoulder_Joint: [-0.1, 1.0], F_Joint: [0.97, 2.37], A_Joint: [-1.0, 0.6], E_Joint: [-1.72, 0.97],
             wrist1_Joint: [-0.2, 0.3], wrist2_Joint: [-0.9, 0.9], wrist3_Joint: [-1.6, 1.6]}
"""
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


def test_what_carries_its_shoulders_is_seen_and_touches_nothing() -> None:
    robot = load_robot(NAME)
    model = build_model(robot, standing_plan())
    on_base = np.flatnonzero(model.model.geom_bodyid == model.body)
    touching = model.model.geom_contype[on_base] + model.model.geom_conaffinity[on_base] > 0
    seen = model.model.geom_rgba[on_base, 3] > 0
    assert (touching.sum(), seen.sum()) == (1, 5), "a box that collides; the same and four struts to look at"
    assert (touching != seen).all()
    bodies = Bodies(model, mujoco.MjData(model.model))
    trunk = int(np.searchsorted(bodies.moving, model.body))
    shown = [shape["kind"] for shape in bodies.shapes({}) if shape["body"] == trunk]
    assert sorted(shown) == ["box", *["cylinder"] * 4, *["sphere"] * 8]


@pytest.mark.parametrize("slope_deg", [45, pytest.param(90, marks=pytest.mark.sweep)])
def test_it_climbs_one_step_of_its_wall(slope_deg: int, tmp_path: Path) -> None:
    """Planned, checked, climbed, and computed again from the log: some 15 s, for its limbs have no closed form."""
    robot, log = load_robot(NAME), tmp_path / "log.mcap"
    assert robot.limbs[0].transmission.five_bar is not None
    wall = (ROOT / "msgs" / "scenarios" / "climb-makers.yaml").read_text(encoding="utf-8")
    found = unproven(parse_scenario(wall.replace("slope_deg: 45", f"slope_deg: {slope_deg}")), robot)
    climbs_and_replays(found, robot, log)


def variant(row: str, mapping: str) -> str:
    """The mapping with the limits and motors of a row of the page."""
    efforts = "{default: 4.1, Shoulder_Joint: 8.2, F_Joint: 8.2, A_Joint: 8.2}"
    assert efforts in mapping
    if "teleoperation" in row:
        return re.sub(r"^limits_rad:.*\n.*\n", TELEOPERATED.lstrip(), mapping, flags=re.MULTILINE)
    if "4.1 Nm" in row:
        return mapping.replace(efforts, "{default: 4.1}")
    if "shoulder" not in row:
        return mapping.replace(efforts, efforts.replace("Shoulder_Joint: 8.2, ", ""))
    assert "the mapping" in row
    return mapping


def rows() -> list[tuple[str, str]]:
    page = (ROOT / "docs" / "your-robot.md").read_text(encoding="utf-8")
    table = page.split("| limits and motors | first wall |\n| --- | --- |\n")[1].split("\n\n")[0]
    return [(cells[1].strip(), cells[2].strip()) for cells in (line.split("|") for line in table.splitlines())]


@pytest.mark.parametrize(
    ("row", "wall"), [pytest.param(*row, marks=[pytest.mark.sweep] * row[1].startswith("at least")) for row in rows()]
)
def test_the_page_says_what_variants_climb(
    row: str, wall: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path))
    mapping, file = tmp_path / "mapping.yaml", tmp_path / "wall.yaml"
    mapping.write_text(variant(row, (MAKERS / "mapping.yaml").read_text(encoding="utf-8")), encoding="utf-8")
    words = ["robot", "import", str(MAKERS / "scaler.urdf"), "--mapping", str(mapping), "-o", str(tmp_path / "makers")]
    assert cli.main(words) == 0
    capsys.readouterr()
    if least := re.fullmatch(r"at least (\d+) degrees", wall):
        assert cli.main(["robot", "check", str(tmp_path / "makers"), "--wall", str(file)]) == 0
        assert load_scenario(file).wall.slope_deg >= int(least[1])
        return
    cli.main(["robot", "check", str(tmp_path / "makers"), "--json"])
    checks = {check["topic"]: check for check in json.loads(capsys.readouterr().out)["checks"]}
    if slopes := re.fullmatch(r"none: three limbs do not hold it at (.*) degrees", wall):
        assert checks["peak torques"]["remedy"] == f"does not hold on three limbs at {slopes[1]} degrees"
    else:
        assert wall == "none: no upright grip"
        assert checks["reach"]["remedy"].startswith("LF, RF, LR, RR: no grip within the joint limits")
