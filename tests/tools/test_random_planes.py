"""Random walls of two planes: what they are, that they are the same again, and climbs on them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import crux_planner
import numpy as np
import pytest
import yaml
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_simulation.benchmarks.many_walls import DRAWN
from crux_simulation.benchmarks.random_planes import random_planes
from crux_simulation.campaign.walls import Wall
from crux_tools.cli import main
from scipy.spatial.transform import Rotation

KINDS = {1: ("convex", "along"), 3: ("hollow", "across"), 8: ("hollow", "along"), 9: ("convex", "across")}


@cache
def text_of(seed: int) -> str:
    return random_planes(seed)


def frame_of(pose: dict[str, Any]) -> tuple[np.ndarray, Rotation]:
    return np.array(pose["position_m"]), Rotation.from_euler("xyz", pose["rpy_deg"], degrees=True)


@pytest.mark.parametrize("seed", KINDS)
def test_planes_meet_as_the_name_says_and_holds_stand_on_them(seed: int) -> None:
    scene = yaml.safe_load(text_of(seed))
    hollow, along, turn_deg, _ = scene["name"].split("-")
    assert (hollow, along) == KINDS[seed]
    planes = [frame_of(each["rectangle"]["pose"]) for each in scene["surfaces"]]
    ups = [turn.apply([0.0, 0.0, 1.0]) for _, turn in planes]
    assert np.degrees(np.arccos(ups[0] @ ups[1])) == pytest.approx(float(turn_deg), abs=0.51)
    between = planes[1][0] - planes[0][0]
    assert [float(between @ ups[0]) > 0.0, float(between @ ups[1]) < 0.0] == [hollow == "hollow"] * 2
    edge = np.cross(*ups)
    assert abs(edge[0 if along == "along" else 1]) == pytest.approx(np.linalg.norm(edge), abs=1e-6)
    on = [0, 0]
    for hold in scene["holds"]:
        foot, turn = frame_of(hold["pose"])
        off = [abs((foot - middle) @ up) for (middle, _), up in zip(planes, ups, strict=True)]
        nearest = int(np.argmin(off))
        assert off[nearest] < 3e-4
        assert turn.apply([0.0, 0.0, 1.0]) @ ups[nearest] == pytest.approx(1.0, abs=1e-6)
        on[nearest] += 1
    assert min(on) >= 2


def test_a_seed_is_one_wall() -> None:
    assert Wall(DRAWN, 3).scenario() == text_of(3)
    assert len({text_of(seed) for seed in KINDS}) == len(KINDS)


def test_a_body_goes_into_a_hollow_with_its_limbs() -> None:
    """Its pitch follows the planes, and every limb ends one or two rows farther on."""
    scenario = parse_scenario(text_of(3))
    plan = crux_planner.plan(scenario, load_robot("scaler")).plan
    pitch_deg = np.degrees([knot.body_rpy_rad[1] for knot in plan.knots])
    assert np.ptp(pitch_deg) > 10.0
    begin, end = ([limb.hold for limb in plan.knots[k].limbs] for k in (0, -1))
    assert all(one != other for one, other in zip(begin, end, strict=True))


def test_a_wall_without_a_first_move_says_what_keeps_each_limb() -> None:
    """And not how far a level body's limbs are from the goal's holds."""
    with pytest.raises(crux_planner.InfeasibleError) as error:
        crux_planner.plan(parse_scenario(text_of(115)), load_robot("scaler"))
    assert "nearest to the goal was LF left-2, RF right-2, LR left-0, RR right-0: LF has to stay" in str(error.value)
    assert str(error.value).count("motors are too weak without it") == 4
    assert not error.value.proven


def test_drawn_walls_stand_in_for_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["bench", "walls", "--drawn", "2", str(tmp_path / "any.yaml"), "--output", str(tmp_path / "out")]
    assert main(given) == 2
    assert "--drawn: takes no scenario files beside it" in capsys.readouterr().err


@pytest.mark.sweep
def test_twenty_are_decided_and_climbed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """About 5 minutes."""
    assert main(["bench", "walls", "--drawn", "20", "--seed", "101", "--output", str(tmp_path), "--json"]) == 0
    lines = json.loads(capsys.readouterr().out)["walls"]
    assert sum(line["verdict"] == "solved" for line in lines) >= 18
    assert all(line["climbed"] and line["slips"] == 0 for line in lines if line["verdict"] == "solved")
