"""Hands on holds and feet on footholds in one plan, in hardware-in-the-loop. Needs the build."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from climbs import climb_here, saved
from crux_contracts.robot import load_robot
from crux_msgs import truth_contacts_t
from crux_simulation.sim.judge import pad_travel
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.guide.guide import Guide
from crux_tools.guide.replanner import Replanner
from crux_tools.report.command import write_report
from crux_tools.telemetry.channels import read_channels
from crux_tools.telemetry.reader import read_log
from crux_tools.view.recording import recording_of
from feet_plan import ASIDE_M, FEET, FRICTION, MOVES, STEP_M, stepping_plan

DESCENDS, CLOSES = 5, 6  # limb_reference_t.phase
HAND_PADS, FOOT_PADS = slice(0, 4), slice(4, 8)


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_a_foot_steps_while_hands_hold(tmp_path: Path) -> None:
    plan, log, page = saved(tmp_path, stepping_plan()), tmp_path / "log.mcap", tmp_path / "feet.html"
    status, result = climb_here(plan, log)
    assert status == 0, result
    assert (result["slips"], result["lost_grips"], result["fell"]) == (0, [], False)
    assert result["tracking"]["body_m"] < 0.02

    # In truth feet touch the wall alone, hands holds alone, and the foot has stepped.
    contacts = read_channels(log).tables["/truth/contacts"]
    touched = contacts["pad_hold"].reshape(-1, 8)
    assert set(np.unique(touched[:, FOOT_PADS])) == {truth_contacts_t.WALL, truth_contacts_t.NOTHING}
    assert set(np.unique(touched[:, HAND_PADS])) <= {0, 1, truth_contacts_t.NOTHING}
    climb = read_log(log)
    place_m = climb.limbs["gripper_position_w_m"][:, MOVES]
    assert place_m[-1, 0] - place_m[0, 0] == pytest.approx(STEP_M, abs=0.008)

    # What feet are asked for is a push within friction.
    force_n = climb.limbs["force_reference_w_n"][climb.state["plan_time_s"] > 0][:, FEET]
    along, normal = np.hypot(force_n[..., 0], force_n[..., 1]), force_n[..., 2]
    assert normal.max() > 20.0
    assert np.all(along <= FRICTION * normal + 1e-6)

    assert main(["replay", str(log), "--check", "--no-view"]) == 0
    write_report(log, page)
    least = re.search(r"smallest margin of a finger[^<]*</th><td>(\S+) N", page.read_text(encoding="utf-8"))
    assert least is not None
    assert float(least[1]) > 0.0
    for path in (plan, log):
        assert recording_of(path) is not None


@pytest.mark.parametrize("higher_m", [0.008, -0.02])
def test_a_foot_stops_at_its_surface_where_it_is(tmp_path: Path, higher_m: float) -> None:
    plan, log = saved(tmp_path, stepping_plan((0.0, ASIDE_M), higher_m)), tmp_path / "log.mcap"
    status, result = climb_here(plan, log)
    assert status == 0, result
    assert result["slips"] == 0
    climb = read_log(log)
    height_m = climb.limbs["gripper_position_w_m"][:, MOVES, 2]
    assert height_m[-1] - height_m[0] == pytest.approx(higher_m, abs=0.004)
    # It lands far more gently than it is to stand there in the end.
    lands = np.isin(climb.references["phase"][:, MOVES], (DESCENDS, CLOSES))
    force_n = climb.limbs["force_w_n"][:, MOVES, 2]
    assert force_n[lands].max() < 0.5 * force_n[-1]


def test_no_guide_takes_a_plan_with_footholds() -> None:
    nobody: Any = None
    with pytest.raises(UsageError, match="limbs stand on footholds"):
        Guide(nobody, stepping_plan(), load_robot("scaler"), print)
    with pytest.raises(UsageError, match="limbs stand on footholds"):
        Replanner(nobody, stepping_plan(), load_robot("scaler"), print)


def test_a_limb_with_footholds_slips_on_the_wall_and_others_do_not() -> None:
    position = np.zeros((40, 8, 3))
    position[20:, [3, 7], 0] = 0.02
    truth: Any = SimpleNamespace(
        pad_position_m=position,
        pad_force_n=np.full((40, 8), 12.0),
        pad_face=np.zeros((40, 8), dtype=int),  # face 0 is the wall
        gripper_rotation=np.tile(np.eye(3), (40, 4, 1, 1)),
    )
    stands = np.array([False, False, False, True])
    travels = pad_travel(truth, np.array([-1]), 5.0, stands=stands)
    assert sorted(travels) == pytest.approx([0.0, 0.02])
