"""`crux wall check`: reasons in numbers, bodies from which the checker's inverse kinematics confirms a hold, and where
the way up ends.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.checker.geometry import rotation_about_z
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.method_report import wall_offers, wall_report
from crux_tools.cli import main
from crux_tools.paths import SCENARIOS

if TYPE_CHECKING:
    from crux_planner.method_report import WallReport

SIDE_M, UP_M = 0.36, 0.14
START = {"LF": (UP_M, SIDE_M), "RF": (UP_M, -SIDE_M), "LR": (-UP_M, SIDE_M), "RR": (-UP_M, -SIDE_M)}


def hold(
    name: str, x: float, y: float, size_m: tuple[float, float, float] = (0.06,) * 3, **more: Any
) -> dict[str, Any]:
    return {"name": name, "position_m": [x, y], "size_m": list(size_m), "friction": 2.2, **more}


def wall(*others: dict[str, Any]) -> dict[str, Any]:
    return {
        "version": 1,
        "name": "checked",
        "robot": "scaler",
        "wall": {"slope_deg": 60},
        "contact": {
            "model": "patch", "patch_radius_m": 0.0109, "max_normal_N": 60, "spine_shear_N": 5, "spine_twist_Nm": 0.05,
        },
        "holds": [*(hold(limb, *place) for limb, place in START.items()), *others],
        "start": {
            "body": {"position_m": [0.0, 0.0, 0.185]},
            "grasps": {limb: {"hold": limb, "faces": "x"} for limb in START},
        },
        "goal": {"body": {"position_m": [0.1, 0.0, 0.185]}},
        "horizon": {"steps": 40, "dt_s": 2.0},
    }  # fmt: skip


def report_on(others: Sequence[dict[str, Any]], looks: int = 1) -> WallReport:
    """With so many looks at moves, whatever time they take."""
    return wall_report(parse_scenario(wall(*others)), load_robot("scaler"), np.inf, looks, lambda _share: None)


def checked(folder: Path, given: dict[str, Any], capsys: pytest.CaptureFixture[str], status: int = 0) -> dict[str, Any]:
    path = folder / "wall.yaml"
    path.write_text(yaml.safe_dump(given), encoding="utf-8")
    assert (
        main(["wall", "check", str(path), "--json", "--time-limit", "600", "--picture", str(folder / "w.png")])
        == status
    )
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert (folder / "w.png").read_bytes().startswith(b"\x89PNG")
    return said


@lru_cache
def reached(limb: str, body_m: tuple[float, ...], heading_rad: float, at: tuple[float, float], pads_m: float) -> bool:
    """By the checker's inverse kinematics, with any yaw of the gripper that fits faces x or y of an unturned hold."""
    model = next(each for each in load_model(load_robot("scaler")).limbs if each.name == limb)
    yaws = np.array([-np.pi / 2, 0.0, np.pi / 2]) - heading_rad
    place = rotation_about_z(np.array([-heading_rad]))[0] @ (np.array([*at, pads_m]) - np.array(body_m))
    (found,) = solve([model], [np.tile(place, (3, 1))], [rotation_about_z(yaws)])
    good = (found.position_error_m < 1e-4) & (found.rotation_error_rad < 1e-3)
    inside = (found.q_rad >= model.lower_rad) & (found.q_rad <= model.upper_rad)
    return bool((good & inside.all(axis=1)).any())


def test_each_pair_of_faces_that_is_none_says_why() -> None:
    odd = [
        hold("low", 0.5, 0.0, (0.06, 0.06, 0.03)),
        hold("high", 0.5, 0.3, (0.06, 0.06, 0.3)),
        hold("narrow", 0.5, -0.3, (0.06, 0.015, 0.06)),
        hold("wide", 0.75, 0.0, (0.2, 0.06, 0.06)),
        hold("smooth", 0.75, 0.3, friction={"+x": 2.2, "-x": 0.0, "+y": 2.2, "-y": 2.2, "top": 0.0}),
        hold("beside", 0.75, -0.3),
        hold("neighbour", 0.8255, -0.3),
    ]
    why = {(pair.hold, pair.faces): pair.reason for pair in report_on(odd).pairs}
    assert "it is 0.03 m high, lower than the 0.0309 m" in why["low", "x"]
    assert "it is 0.3 m high, higher than" in why["high", "y"]
    assert "narrower than the patch, 0.0218 m" in why["narrow", "x"]
    assert "it is 0.015 m wide" in why["narrow", "y"]
    assert "it is 0.2 m wide" in why["wide", "x"]
    assert why["smooth", "x"] == "face -x has friction 0, both faces of a grasp need more"
    assert not why["smooth", "y"]
    left_mm = 15.5 - 1000 * load_robot("scaler").gripper.pad_radius_m  # faces are 15.5 mm apart; found to a millimetre
    assert f"neighbours leave {int(left_mm)} mm beside the fingers, they need 18 mm" in why["beside", "x"]
    assert not why["beside", "y"]
    assert not any(why[limb, faces] for limb in START for faces in "xy")


def test_a_limb_holds_from_where_it_says_and_from_nowhere_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = checked(tmp_path, wall(), capsys)
    pads_m = 0.035
    for pair in said["pairs"]:
        at = START[pair["hold"]]
        assert set(pair["limbs"]) == set(START)
        for limb, place in pair["limbs"].items():
            assert reached(limb, tuple(place["body_m"]), np.radians(place["heading_deg"]), at, pads_m)
            assert 0.0 < place["share"] < 0.5
    place = said["pairs"][0]["limbs"]["LF"]
    (x0, x1), (y0, y1) = place["x_m"], place["y_m"]
    outside = [(x0 - 0.06, y) for y in np.linspace(y0, y1, 4)] + [(x1 + 0.06, y) for y in np.linspace(y0, y1, 4)]
    outside += [(x, y) for x in np.linspace(x0, x1, 4) for y in (y0 - 0.06, y1 + 0.06)]
    for x, y in outside:
        for turn in (-0.2, 0.0, 0.2):
            assert not reached("LF", (float(x), float(y), 0.1875), turn, START["LF"], pads_m)


def test_every_place_with_a_stance_is_told_and_the_limbs_reach_their_holds_from_it() -> None:
    report = wall_offers(parse_scenario(wall()), load_robot("scaler"))
    assert len({stance.body_m for stance in report.stances}) == len(report.stances) > 20
    for stance in report.stances:
        assert {hold for hold, _ in stance.grasps.values()} == set(START)
        assert all(reached(limb, stance.body_m, 0.0, START[hold], 0.035) for limb, (hold, _) in stance.grasps.items())
    assert report.top is None


@pytest.mark.parametrize("left_out", [["start", "goal"], ["goal"]])
def test_a_wall_without_start_or_goal_is_looked_at_from_its_lowest_stance(
    left_out: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `crux wall import` may leave it."""
    whole = checked(tmp_path, wall(), capsys)
    given = {name: each for name, each in wall().items() if name not in left_out}
    said = checked(tmp_path, given, capsys)
    assert said["pairs"] == whole["pairs"] or "start" in left_out
    assert [set(pair["limbs"]) for pair in said["pairs"]] == [set(START)] * 8
    grasps = said["start"]["begun"]["grasps"]
    assert {hold for hold, _ in grasps.values()} == set(START)
    assert said["highest"]["body_m"][0] == pytest.approx(whole["highest"]["body_m"][0], abs=0.03)


def test_the_way_up_ends_where_holds_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = checked(tmp_path, wall(*(hold(f"far-{limb}", x + 1.5, y) for limb, (x, y) in START.items())), capsys)
    top = said["highest"]
    assert top["complete"]
    assert top["moves"] == 0
    assert 0.0 < top["body_m"][0] < 0.35  # the front limbs are at 0.14 m, and reach back by 0.24 m
    assert set(top["stops"].values()) == {"has no other hold in reach while the others hold on"}
    by = {pair["hold"]: pair["reached_from_start_by"] for pair in said["pairs"] if pair["faces"] == "x"}
    assert {name: who for name, who in by.items() if who} == {limb: [limb] for limb in START}


def test_one_gets_higher_by_a_row_of_holds() -> None:
    next_row = [hold(f"next-{limb}", UP_M + 0.16, y) for limb, (_, y) in START.items() if limb.endswith("F")]
    bare, top = (report_on(others, 30).top for others in ((), next_row))
    assert bare is not None
    assert top is not None
    assert top.body_h_m[0] > bare.body_h_m[0] + 0.03
    assert top.moves >= 1


def test_a_start_that_cannot_be_had_is_told_and_another_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = wall()
    given["holds"][0]["friction"] = {"+x": 0.0, "-x": 2.2, "+y": 2.2, "-y": 2.2, "top": 0.0}
    said = checked(tmp_path, given, capsys)
    assert "start.grasps.LF: LF, faces x: face +x has friction 0" in said["start"]["refused"]
    assert said["start"]["begun"]["grasps"]["LF"] == ["LF", "y"]


def test_a_wall_with_too_few_holds_has_no_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = wall()
    given["holds"][3]["position_m"] = [3.0, 0.0]
    said = checked(tmp_path, given, capsys, status=1)
    assert (said["start"]["places"], said["highest"]) == (0, None)


def test_a_walk_has_no_holds_to_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["wall", "check", str(SCENARIOS / "walk-flat.yaml")]) == 2
    assert "contact.model" in capsys.readouterr().err
