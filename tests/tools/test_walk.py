"""Walking on point feet in hardware-in-the-loop. Needs the build."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from climbs import climb_here
from crux_msgs import truth_contacts_t
from crux_simulation.sim.judge import pad_travel
from crux_tools.report.command import write_report
from crux_tools.telemetry.channels import read_channels
from crux_tools.telemetry.reader import read_log
from shared_plans import SharedPlans

SCENES = Path(__file__).resolve().parents[2] / "msgs" / "scenarios"


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_the_flat_walk_reaches_its_goal(tmp_path: Path, planned: SharedPlans) -> None:
    path, log = tmp_path / "walk.mcap", tmp_path / "log.mcap"
    planned.write("walk-flat", path)
    status, result = climb_here(path, log)
    assert status == 0, result
    assert result["reached_goal"]
    assert not result["fell"]
    assert result["slips"] == 0
    assert result["tracking"]["body_m"] < 0.02

    # What acts along the wall follows the normal forces: as planned, feet are asked for 0.38 of theirs.
    climb = read_log(log)
    force_n = climb.limbs["force_reference_w_n"][climb.state["plan_time_s"] > 0]
    along, normal = np.hypot(force_n[..., 0], force_n[..., 1]), force_n[..., 2]
    assert np.all(along < 0.25 * normal + 0.1)

    # In truth feet touch nothing but the wall.
    touched = read_channels(log).tables["/truth/contacts"]["pad_hold"]
    assert set(np.unique(touched)) == {truth_contacts_t.WALL, truth_contacts_t.NOTHING}

    # Its report: a foot bears no moment, and feet do not squeeze.
    page = tmp_path / "walk.html"
    write_report(log, page)
    least = re.search(r"smallest margin of a foot</th><td>(\S+) N", page.read_text(encoding="utf-8"))
    assert least is not None
    assert -2.0 < float(least[1]) < 10.0


@pytest.mark.parametrize(("axis", "slid"), [(0, 0.02), (1, 0.02), (2, 0.0)])
def test_a_foot_slips_along_the_wall_only(axis: int, slid: float) -> None:
    position = np.zeros((40, 8, 3))
    position[20:, 3, axis] = 0.02
    truth: Any = SimpleNamespace(
        pad_position_m=position,
        pad_force_n=np.full((40, 8), 12.0),
        pad_face=np.zeros((40, 8), dtype=int),  # face 0 is the wall
        gripper_rotation=np.tile(np.eye(3), (40, 4, 1, 1)),
    )
    assert max(pad_travel(truth, np.array([-1]), 5.0, point_feet=True)) == pytest.approx(slid)
    assert pad_travel(truth, np.array([-1]), 5.0) == []
