"""Walls of two planes: where the planes are, and what stands on each of them and across their edge."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, load_scenario
from crux_planner.pipeline.wall_check import StartStance
from crux_simulation.wall.box import Box
from crux_simulation.wall.boxes import apart, boxes
from crux_simulation.wall.frame import CLIMBED, Frame, Placed, placed
from crux_simulation.wall.parts import Bounded, Part, bounded, parts
from crux_simulation.wall.places import Places, bodies
from crux_simulation.wall.planes import planes
from crux_simulation.wall.stances import Ends, Way, ends
from crux_simulation.wall.surface import Surface
from crux_tools.cli import main
from crux_tools.telemetry.rotations import rpy_of
from scipy.spatial.transform import Rotation

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


def bent(degrees: float, extra: trimesh.Trimesh | None = None, holds: int = 2) -> trimesh.Trimesh:
    """Two planes at an angle, positive where the wall is hollow, with so many holds on each."""
    frame = second(degrees)
    end = frame @ [0.45, 0.0, 0.0, 1.0]
    sheet = folded([(-0.45, 0.0), (EDGE_M, 0.0), (end[0], end[2])])
    solids = [standing(np.eye(4), *place) for place in CLIMBED_M[:holds]]
    solids += [standing(frame, *place) for place in OTHER_M[:holds]]
    return trimesh.util.concatenate([sheet, *solids, *([] if extra is None else [extra])])


def looked_at(mesh: trimesh.Trimesh) -> tuple[Placed, list[Part], list[Bounded]]:
    """The wall in its frame, what stands on its planes, and those of them that have edges."""
    surface = Surface(np.array(mesh.vertices), np.array(mesh.faces, np.int64))
    wall = placed(surface, np.array([0.0, 0.0, 1.0]), None, 90.0)
    samples = wall.surface.samples
    on = planes(samples)
    of = bodies(wall.surface, on)
    return wall, parts(samples, on, of), bounded(wall.surface, on, of)


def count(part: Part) -> int:
    return len(np.unique(part.body[part.body >= 0]))


@pytest.mark.parametrize("degrees", [15.0, 90.0, 130.0, -60.0])
def test_the_bodies_of_a_plane_are_looked_at_in_its_frame(degrees: float) -> None:
    wall, (climbed, other), _ = looked_at(bent(degrees))
    assert (climbed.frame, count(climbed), climbed.reason) == (CLIMBED, len(CLIMBED_M), "")
    assert count(other) == len(OTHER_M)
    assert other.frame.rotation[2] == pytest.approx(second(degrees)[:3, 2], abs=2e-3)
    why = f"is on another plane, turned by {-degrees:.0f}° about y: holds are turned by at most 90°"
    assert other.reason == (why if degrees > 90.0 else "")
    points = other.frame.seen(wall.surface.samples.points[other.body >= 0])
    assert points[:, 2].max() == pytest.approx(0.06, abs=2e-3)
    for x, y in OTHER_M:
        at = other.frame.seen((wall.offset + (second(degrees) @ [x, y, 0.06, 1.0])[:3])[None])
        assert at[0, 2] == pytest.approx(0.06, abs=2e-3)
        assert (np.linalg.norm(points - at, axis=1) < 0.01).any()


@pytest.mark.parametrize("degrees", [50.0, -50.0])
def test_a_body_on_both_planes_is_looked_at_from_between_them(degrees: float) -> None:
    middle = second(degrees / 2.0)
    wall, found, _ = looked_at(bent(degrees, standing(middle, 0.0, 0.1)))
    assert [count(part) for part in found] == [len(CLIMBED_M), len(OTHER_M), 1]
    frame = found[2].frame
    assert frame.rotation[2] == pytest.approx(middle[:3, 2], abs=2e-3)
    assert frame.origin_m == pytest.approx(wall.offset + np.array([EDGE_M, 0.1, 0.0]), abs=3e-3)


def test_a_panel_that_stands_out_is_a_plane_of_its_own() -> None:
    frame = trimesh.transformations.translation_matrix([EDGE_M, 0.0, 0.08])
    sheet = folded([(-0.45, 0.0), (EDGE_M, 0.0), (EDGE_M, 0.08), (0.65, 0.08)])
    holds = [standing(np.eye(4), *place) for place in CLIMBED_M] + [standing(frame, *OTHER_M[1])]
    wall, (_, other), (panel,) = looked_at(trimesh.util.concatenate([sheet, *holds]))
    assert count(other) == 1
    assert panel.name == "plane-2"
    assert panel.frame.rotation == pytest.approx(np.eye(3), abs=5e-3)
    assert panel.frame.origin_m == pytest.approx(wall.offset + np.array([0.45, 0.0, 0.08]), abs=6e-3)
    assert panel.size_m == pytest.approx([0.4, WIDE_M], abs=0.01)


def test_a_large_hold_and_the_back_of_a_panel_are_no_planes() -> None:
    slab = trimesh.creation.box((0.8, WIDE_M, 0.1), trimesh.transformations.translation_matrix([0, 0, -0.05]))
    volume = trimesh.creation.box((0.24, 0.24, 0.2), trimesh.transformations.translation_matrix([0, 0, 0.09]))
    _, (climbed,), others = looked_at(trimesh.util.concatenate([slab, volume]))
    assert (count(climbed), others) == (1, [])


@pytest.mark.parametrize("degrees", [60.0, -60.0])
def test_the_scenario_has_the_holds_of_both_planes_and_of_the_edge(
    degrees: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the second plane falls behind the first, that ends at the edge, too."""
    scan, wall = tmp_path / "scan.ply", tmp_path / "wall.yaml"
    between, other = second(degrees / 2.0), second(degrees)
    astride = standing(between, 0.0, 0.05) if degrees < 0.0 else None
    bent(degrees, astride, holds=1).apply_transform(TURN).export(scan)
    frame = [f"{value:.9f}" for value in (*OUT, *-UP)]
    assert main(["wall", "import", str(scan), "-o", str(wall), "--outward", *frame[:3], "--down", *frame[3:], "--json"])
    offset = np.array(json.loads(capsys.readouterr().out)["offset_m"])
    document = yaml.safe_load(wall.read_text(encoding="utf-8"))
    with pytest.raises(ScenarioError, match=r"(?s)^\S*: start: is missing\n\S*: goal: is missing$"):
        load_scenario(wall)
    true = [(np.eye(4), *CLIMBED_M[0]), (other, *OTHER_M[0])] + ([(between, 0.0, 0.05)] if astride else [])
    assert len(document["holds"]) == len(true)
    for plane, x, y in true:
        foot = offset + (plane @ [x, y, 0.0, 1.0])[:3]
        poses = (each["pose"] for each in document["holds"])
        nearest = min(poses, key=lambda each: float(np.linalg.norm(foot - each["position_m"])))
        assert nearest["position_m"] == pytest.approx(foot, abs=2e-3)
        turn = plane[:3, :3].T @ Rotation.from_euler("xyz", nearest["rpy_deg"], degrees=True).as_matrix()
        assert turn[2] == pytest.approx([0.0, 0.0, 1.0], abs=5e-3)
        assert np.abs(turn[:2, :2]).max(axis=0) == pytest.approx([1.0, 1.0], abs=5e-3)  # square to the block
    assert all(each["shape"]["box_m"] == pytest.approx([0.06] * 3, abs=1.5e-3) for each in document["holds"])
    sheets = {"plane-2": (other @ [0.225, 0.0, 0.0, 1.0], [0.45, WIDE_M])}
    if degrees < 0.0:
        sheets["wall"] = (np.array([(EDGE_M - 0.45) / 2.0, 0.0, 0.0, 1.0]), [EDGE_M + 0.45, WIDE_M])
    else:
        assert document["surfaces"].pop(0)["plane"] == {"point_m": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    assert {each["name"] for each in document["surfaces"]} == set(sheets)
    for each in document["surfaces"]:
        middle, size = sheets[each["name"]]
        assert each["rectangle"]["pose"]["position_m"] == pytest.approx(offset + middle[:3], abs=8e-3)
        assert each["rectangle"]["size_m"] == pytest.approx(size, abs=0.015)
        assert each["rectangle"]["depth_m"] == 0.05


@pytest.mark.parametrize("pitch", [0.4, -np.pi / 2, np.pi / 2])
def test_a_rotation_is_that_of_its_roll_pitch_and_yaw(pitch: float) -> None:
    rotation = Rotation.from_euler("ZYX", [-2.1, pitch, 0.7]).as_matrix()
    assert Rotation.from_euler("xyz", rpy_of(rotation)).as_matrix() == pytest.approx(rotation, abs=1e-9)


def test_boxes_of_two_planes_stand_apart() -> None:
    """A hold of one plane stays, an obstacle of another is what of it is not in that hold, a second hold is none."""
    side = Frame.on(np.array([-1.0, 0.0, 0.0]), np.array([0.1, 0.0, 0.0]))  # over x = 0.1 of W, facing down
    hold = Box("hold-1", np.array([0.05, 0.0]), np.array([0.06, 0.06, 0.05]), 0.3, (True, True), (0.0, 0.0), "")
    sill = Box("body-2", np.zeros(2), np.array([0.4, 0.05, 0.06]), 1.2, (False, False), (0.0, 0.0), "rough", frame=side)
    second = replace(hold, name="hold-3", position_m=np.array([0.0, 0.03]), frame=side)
    kept = apart([sill, hold, second])
    assert (kept[0], kept[0].is_hold, [box.is_hold for box in kept[1:]]) == (hold, True, [False] * (len(kept) - 1))
    assert len({box.name for box in kept}) == len(kept) > 3
    assert {box.reason for box in kept if box.name.startswith("body-3")} == {
        "its cuboid would stand in that of another hold"
    }
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (4000, 3)) * sill.size_m + [0.0, 0.0, 0.03]
    points = sill.foot_m + points @ sill.rotation.T
    in_hold = inside(hold, points, 0.0)
    in_pieces = np.any([inside(box, points, 0.0) for box in kept if box.name.startswith("body-2")], axis=0)
    assert in_hold.any()
    assert not (in_hold & in_pieces).any()
    assert in_pieces[~inside(hold, points, 0.03)].all()


def inside(box: Box, points: np.ndarray, more_m: float) -> np.ndarray:
    """Which points are in a cuboid that is so much larger on all sides."""
    off = np.abs((points - box.foot_m) @ box.rotation - [0.0, 0.0, box.size_m[2] / 2.0])
    return np.asarray((off < box.size_m / 2.0 + more_m).all(axis=1))


def test_a_vertical_plane_is_a_thin_obstacle() -> None:
    """All its points are on one line, as seen from off the wall."""
    along, height_m = np.linspace(-0.5, 0.5, 40), np.linspace(0.0, 0.8, 30)
    points = np.array([[0.6 * a, 0.8 * a, z] for a in along for z in height_m])
    found = boxes(_NOWHERE, _NUMBERS, _NO_PLACES, _NUMBERS, ROBOT, [("side", points, "there")])
    assert [box.reason for box in found] == ["there"]
    assert found[0].size_m == pytest.approx([1.0, 0.005, 0.8])
    assert np.tan(found[0].yaw_rad) == pytest.approx(0.8 / 0.6)


def stance(x_m: float, hold: str) -> StartStance:
    return StartStance((x_m, 0.0, 0.19), {"LF": (hold, "x")})


def test_start_and_goal_are_those_with_the_highest_way() -> None:
    """Starts are asked about once for the same grasps, in the middle of their places, until one leads high enough."""
    low = [stance(x, "wide") for x in (0.0, 0.02, 0.04)] + [stance(0.01, "narrow"), stance(0.03, "apart")]
    high = [stance(0.5, "middle"), stance(1.0, "top")]
    goals, asked = {"wide": None, "narrow": high[0], "apart": stance(0.8, "over")}, []

    def way_up(start: StartStance) -> Way | str:
        asked.append((start.body_m[0], start.grasps["LF"][0]))
        goal = goals[asked[-1][1]]
        return "is blocked" if goal is None else Way(goal, 2, {})

    assert ends(low + high, way_up) == Ends(low[4], goals["apart"])
    assert asked == [(0.02, "wide"), (0.01, "narrow"), (0.03, "apart")]
    goals["apart"] = None
    assert ends(low + high, way_up) == Ends(low[3], high[0])
    goals["narrow"] = None
    blocked = "a level body has four holds in reach at 7 places, but none of the 3 tried can be a start; the first: "
    assert ends(low + high, way_up) == Ends(without=f"{blocked}is blocked")


def test_a_start_from_where_no_limb_moves_on_is_none() -> None:
    found = [stance(0.0, "low"), stance(1.0, "high")]
    stuck = Way(stance(0.05, "low"), 0, {"LF": "has no other hold in reach while the others hold on"})
    said = (
        "a level body has four holds in reach at 2 places, but no way up was found from the 1 tried; the first: LF has"
    )
    assert ends(found, lambda _: stuck).without.startswith(said)
