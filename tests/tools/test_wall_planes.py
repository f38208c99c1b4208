"""Walls of two planes: what stands on the other one is no hold of the first; what stands out of that is in the way."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from crux_contracts.robot import load_robot
from crux_simulation.wall.boxes import boxes
from crux_simulation.wall.frame import Placed, placed
from crux_simulation.wall.places import Places, bodies
from crux_simulation.wall.planes import Elsewhere, elsewhere, planes
from crux_simulation.wall.stances import Stance, ends
from crux_simulation.wall.surface import Surface
from crux_tools.cli import main

WIDE_M = 0.7
EDGE_M = 0.25  # where the second plane begins
CLIMBED_M = [(-0.25, 0.15), (-0.1, -0.2)]  # holds on the plane that is climbed
OTHER_M = [(0.15, 0.2), (0.3, -0.1)]  # on the second, from the edge on
TURN = trimesh.transformations.euler_matrix(0.3, -0.8, 0.5)  # of the wall in its scan
UP, OUT = TURN[:3, 0], TURN[:3, 2]
ROBOT = load_robot("scaler")
_NOWHERE = Surface(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
_NONE, _PAIRS, _NUMBERS = np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64)
_NO_PLACES = Places(np.zeros((0, 3)), _NONE, _NONE, _PAIRS, _PAIRS, _PAIRS, _PAIRS, _NUMBERS)
BLOCK = trimesh.creation.box((0.06, 0.06, 0.065))


def standing(frame: np.ndarray, x: float, y: float) -> trimesh.Trimesh:
    """A block of 60 mm on a plane with this frame."""
    return BLOCK.copy().apply_transform(frame @ trimesh.transformations.translation_matrix([x, y, 0.0275]))


def folded(profile_m: list[tuple[float, float]]) -> trimesh.Trimesh:
    """A sheet through places (x, z)."""
    rows = np.array([[x, side * WIDE_M / 2.0, z] for x, z in profile_m for side in (-1, 1)])
    faces = [[2 * i + corner for corner in half] for i in range(len(profile_m) - 1) for half in ((0, 2, 1), (1, 2, 3))]
    return trimesh.Trimesh(rows, faces)


def second(degrees: float) -> np.ndarray:
    """The frame of a plane that rises so from the first one's upper edge."""
    frame: np.ndarray = trimesh.transformations.rotation_matrix(-np.radians(degrees), [0, 1, 0])
    frame[:3, 3] = [EDGE_M, 0.0, 0.0]
    return frame


def bent(degrees: float, extra: trimesh.Trimesh | None = None) -> trimesh.Trimesh:
    """Two planes at an angle, positive where the wall is hollow, with two holds on each."""
    frame = second(degrees)
    end = frame @ [0.45, 0.0, 0.0, 1.0]
    sheet = folded([(-0.45, 0.0), (EDGE_M, 0.0), (end[0], end[2])])
    holds = [standing(np.eye(4), *place) for place in CLIMBED_M] + [standing(frame, *place) for place in OTHER_M]
    return trimesh.util.concatenate([sheet, *holds, *([] if extra is None else [extra])])


def looked_at(mesh: trimesh.Trimesh) -> tuple[Placed, int, list[Elsewhere]]:
    """The wall in its frame, how many bodies stand on the plane that is climbed, and the others."""
    surface = Surface(np.array(mesh.vertices), np.array(mesh.faces, np.int64))
    wall = placed(surface, np.array([0.0, 0.0, 1.0]), None, 90.0)
    samples = wall.surface.samples
    on = planes(samples)
    of = bodies(wall.surface, on)
    return wall, len(np.unique(of[(of >= 0) & (on.of == 0)])), elsewhere(samples, on, of)


@pytest.mark.parametrize("degrees", [15.0, 90.0, 130.0, -60.0])
def test_bodies_on_another_plane_say_how_it_lies(degrees: float) -> None:
    wall, climbed, others = looked_at(bent(degrees))
    assert climbed == len(CLIMBED_M)
    assert {body.reason for body in others} == {f"is on another plane, turned by {-degrees:.0f}° about y"}
    assert len(others) == len(OTHER_M)
    for x, y in OTHER_M:
        middle = wall.offset + (second(degrees) @ [x, y, 0.035, 1.0])[:3]  # of what stands off its plane
        assert min(float(np.linalg.norm(body.position_m - middle)) for body in others) < 0.01


@pytest.mark.parametrize("degrees", [50.0, -50.0])
def test_a_body_on_both_planes_is_one(degrees: float) -> None:
    middle = second(degrees / 2.0)
    _, climbed, others = looked_at(bent(degrees, standing(middle, 0.0, 0.1)))
    assert climbed == len(CLIMBED_M) + 1
    reasons = sorted(body.reason for body in others)
    assert reasons == [f"is on another plane, turned by {-degrees:.0f}° about y"] * 2 + ["lies across two planes"]


def test_a_panel_that_stands_out_is_a_plane_of_its_own() -> None:
    frame = trimesh.transformations.translation_matrix([EDGE_M, 0.0, 0.08])
    sheet = folded([(-0.45, 0.0), (EDGE_M, 0.0), (EDGE_M, 0.08), (0.65, 0.08)])
    holds = [standing(np.eye(4), *place) for place in CLIMBED_M] + [standing(frame, *OTHER_M[1])]
    _, _, others = looked_at(trimesh.util.concatenate([sheet, *holds]))
    assert [body.reason for body in others] == ["is on another plane, 0.08 m off the one that is climbed"]


def test_a_large_hold_and_the_back_of_a_panel_are_no_planes() -> None:
    slab = trimesh.creation.box((0.8, WIDE_M, 0.1), trimesh.transformations.translation_matrix([0, 0, -0.05]))
    volume = trimesh.creation.box((0.24, 0.24, 0.2), trimesh.transformations.translation_matrix([0, 0, 0.09]))
    _, climbed, others = looked_at(trimesh.util.concatenate([slab, volume]))
    assert (climbed, others) == (1, [])


def test_the_scenario_has_the_climbed_planes_holds_and_the_rest_in_the_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan, wall = tmp_path / "scan.ply", tmp_path / "wall.yaml"
    bent(60.0).apply_transform(TURN).export(scan)
    frame = [f"{value:.9f}" for value in (*OUT, *-UP)]
    assert main(["wall", "import", str(scan), "-o", str(wall), "--outward", *frame[:3], "--down", *frame[3:], "--json"])
    told = capsys.readouterr()
    said: dict[str, Any] = json.loads(told.out)
    assert "2 not: is on another plane, turned by -60° about y" in told.err
    assert [body["reason"] for body in said["elsewhere"]] == ["is on another plane, turned by -60° about y"] * 2
    document = yaml.safe_load(wall.read_text(encoding="utf-8"))
    assert len(document["holds"]) == len(CLIMBED_M)
    offset = np.array(said["offset_m"])
    for x in np.arange(0.05, 0.45, 0.04):  # the second plane is in the way, and little beside it
        for off_m, covered in ((0.0, True), (0.12, False)):
            place = (second(60.0) @ [x, 0.0, off_m, 1.0])[:3] + offset
            assert any(over(each, place) for each in document["obstacles"]) is covered, (x, off_m)


def over(cuboid: dict[str, Any], place: np.ndarray) -> bool:
    yaw, off = np.radians(cuboid["yaw_deg"]), place[:2] - cuboid["position_m"]
    x, y = off @ [np.cos(yaw), np.sin(yaw)], off @ [-np.sin(yaw), np.cos(yaw)]
    size = cuboid["size_m"]
    return bool(max(abs(x) - size[0] / 2.0, abs(y) - size[1] / 2.0) < 0.006 and place[2] < size[2] + 0.006)


def test_a_vertical_plane_is_a_thin_obstacle() -> None:
    """All its points are on one line, as seen from off the wall."""
    along, height_m = np.linspace(-0.5, 0.5, 40), np.linspace(0.0, 0.8, 30)
    points = np.array([[0.6 * a, 0.8 * a, z] for a in along for z in height_m])
    found = boxes(_NOWHERE, _NUMBERS, _NO_PLACES, _NUMBERS, ROBOT, [("side", points, "there")])
    assert [box.reason for box in found] == ["there"]
    assert found[0].size_m == pytest.approx([1.0, 0.005, 0.8])
    assert np.tan(found[0].yaw_rad) == pytest.approx(0.8 / 0.6)


def test_the_goal_is_one_that_the_planner_takes() -> None:
    """The highest ones that it refuses are passed over; those with the same grasps are asked about once."""
    found = [Stance((0.1 * i, 0.0, 0.19), {"LF": (f"h{i // 2}", "x")}, 0.01 * i) for i in range(9)]
    asked: list[str] = []

    def refusal(stance: Stance) -> str:
        asked.append(stance.grasps["LF"][0])
        return "is blocked" if asked[-1] in ("h3", "h4") else ""

    assert ends(found, refusal) == (found[0], found[4])
    assert " ".join(asked) == "h0 h3 h4 h2"
    assert ends(found[:2] + found[6:], refusal) == (
        "a level body has four holds in reach at 5 places, but none of the 2 tried can be a goal; the first: is blocked"
    )
