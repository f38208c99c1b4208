"""Holds of a scan have grips where pads bear in part, or not all along a face: by what of a disc is on known faces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import crux_planner
import numpy as np
import pytest
import trimesh
import yaml
from climbs import climbs_and_replays
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Grip, Hold, load_scenario
from crux_simulation.wall.box import Box
from crux_simulation.wall.edit.content import scenario_of
from crux_simulation.wall.holds import hold_of
from crux_simulation.wall.places import Places
from crux_tools.cli import main
from crux_tools.telemetry.surfaces import pad_shares_of
from test_wall_import import box, standing

ROBOT = load_robot("scaler")
RADIUS_M = ROBOT.gripper.pad_radius_m
WALL_M = 0.06  # height of bodies that are not low
SHARE = 0.05  # of a disc: by 61 rays, and by many points
SPREAD = 0.03  # that a pad at an end of a hold may bear more than is said: no less than at the middle one


def stepped(wide_m: float, narrow_m: float, ends_m: tuple[float, float, float], height_m: float) -> trimesh.Trimesh:
    """So wide along x from the first to the second of the ends along y, and so narrow from there to the third."""
    a, b, c = ends_m
    half, thin = wide_m / 2, narrow_m / 2
    outline = [(half, a), (half, b), (thin, b), (thin, c), (-thin, c), (-thin, b), (-half, b), (-half, a)]
    points = np.vstack([np.column_stack([outline, np.full(len(outline), z)]) for z in (-0.005, height_m)])
    count = len(outline)
    sides = [(i, (i + 1) % count, count + (i + 1) % count, count + i) for i in range(count)]
    caps = [(0, 1, 6, 7), (2, 3, 4, 5)]
    every = [*sides, *((count + i, count + j, count + k, count + m) for i, j, k, m in caps), *(q[::-1] for q in caps)]
    return trimesh.Trimesh(points, [t for i, j, k, m in every for t in ((i, j, k), (i, k, m))], process=False)


BODIES = {  # by name: the solid about (0, 0), its height, and by pair the ends of its faces along y or x
    "whole": (box(0.06, 0.06, WALL_M), WALL_M, {"x": (-0.03, 0.03), "y": (-0.03, 0.03)}),
    "tall": (box(0.06, 0.06, 0.085), 0.085, {"x": (-0.03, 0.03), "y": (-0.03, 0.03)}),
    "slim": (box(0.06, 0.0155, WALL_M), WALL_M, {"x": (-0.00775, 0.00775)}),
    "low": (box(0.06, 0.06, 0.024), 0.024, {"x": (-0.03, 0.03), "y": (-0.03, 0.03)}),
    "long": (box(0.06, 0.16, 0.024), 0.024, {"x": (-0.08, 0.08)}),
    "nearly": (box(0.06, 0.06, 0.033), 0.033, {"x": (-0.03, 0.03), "y": (-0.03, 0.03)}),
    "stepped": (stepped(0.04, 0.014, (-0.03, 0.02, 0.09), WALL_M), WALL_M, {"x": (-0.03, 0.02)}),
    "unlike": (stepped(0.0244, 0.0155, (-0.03, -0.022, 0.03), WALL_M), WALL_M, {}),
}
AT = dict(zip(BODIES, [(x, y) for x in (-0.2, 0.0, 0.2) for y in (-0.2, 0.0, 0.2)], strict=False))


def imported(folder: Path, solids: list[trimesh.Trimesh], size_m: tuple[float, float]) -> dict[str, Any]:
    slab = trimesh.creation.box((*size_m, 0.1), trimesh.transformations.translation_matrix([0, 0, -0.05]))
    trimesh.util.concatenate([slab, *solids]).export(folder / "scan.ply")
    words = ["wall", "import", str(folder / "scan.ply"), "-o", str(folder / "wall.yaml"), "--down", "-1", "0", "0"]
    assert main(words) == 0
    found: dict[str, Any] = yaml.safe_load((folder / "wall.yaml").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def holds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Hold]:
    """By body, the hold as the scenario has it."""
    solids = [standing(*AT[name], BODIES[name][0]) for name in BODIES]
    found = scenario_of(imported(tmp_path_factory.mktemp("scan"), solids, (0.7, 0.7)), ROBOT, "wall").holds
    near = {
        name: min(found, key=lambda hold: float(np.linalg.norm(np.subtract(hold.position_m, AT[name]))))
        for name in BODIES
    }
    assert len({hold.name for hold in near.values()}) == len(BODIES)
    return near


def middle(hold: Hold, grip: Grip, name: str) -> tuple[str, float]:
    """The pair of faces of the body, and how far along them [m] the grip is off (0, 0)."""
    yaw = hold.yaw_rad + (0.0 if grip.faces == "x" else np.pi / 2)
    faces = "x" if abs(np.cos(yaw)) > np.cos(np.radians(2.0)) else "y"
    c, s = np.cos(hold.yaw_rad), np.sin(hold.yaw_rad)
    along = np.array([-s, c]) if grip.faces == "x" else np.array([c, s])
    place = np.array(hold.position_m) - AT[name] + grip.aside_m * along
    return faces, float(place[1 if faces == "x" else 0])


def on_face(along_m: float, height_m: float, ends_m: tuple[float, float], top_m: float) -> float:
    """What of a pad's disc is on a face, by points of it."""
    u, v = (each.ravel() for each in np.meshgrid(*[np.linspace(-RADIUS_M, RADIUS_M, 241)] * 2))
    u, v = (each[np.hypot(u, v) <= RADIUS_M] for each in (u, v))
    inside = (ends_m[0] <= along_m + u) & (along_m + u <= ends_m[1]) & (height_m + v <= top_m)
    return float(inside.mean())


def test_bodies_that_are_whole_need_no_grips(holds: dict[str, Hold]) -> None:
    for name in ("whole", "tall"):
        assert holds[name].grips == ()
        assert holds[name].size_m == pytest.approx((0.06, 0.06, BODIES[name][1]), abs=1e-3)


@pytest.mark.parametrize("name", ["slim", "low", "long", "nearly"])
def test_the_share_is_what_of_a_disc_is_on_the_face(name: str, holds: dict[str, Hold]) -> None:
    _, top, faces = BODIES[name]
    assert holds[name].grips
    assert {middle(holds[name], grip, name)[0] for grip in holds[name].grips} <= set(faces)
    for grip in holds[name].grips:
        which, along = middle(holds[name], grip, name)
        assert grip.height_m is not None
        expected = on_face(along, grip.height_m, faces[which], top)
        assert grip.share == pytest.approx((expected, expected), abs=SHARE + SPREAD)
        best = max(on_face(0.0, z, faces[which], top) for z in np.arange(*ROBOT.grasp.pad_height_m, 0.001))
        assert expected > best - 2 * SHARE


def test_a_grip_is_where_the_whole_pad_bears(holds: dict[str, Hold]) -> None:
    """On the wide end, the rest of which is not as wide as the gripper closes."""
    (grip,) = holds["stepped"].grips
    which, along = middle(holds["stepped"], grip, "stepped")
    low, high = BODIES["stepped"][2]["x"]
    assert (which, grip.share) == ("x", (1.0, 1.0))
    assert low + RADIUS_M < along < high - RADIUS_M
    assert abs(grip.aside_m) > 0.002


def test_a_long_hold_is_taken_at_either_end(holds: dict[str, Hold]) -> None:
    """A low body of 160 mm, on which nowhere a whole pad bears."""
    grips = holds["long"].grips_on("x") or holds["long"].grips_on("y")
    along = sorted(middle(holds["long"], grip, "long")[1] for grip in grips)
    assert len(along) == 3
    assert along[0] < -0.03 < along[1] < 0.03 < along[2]
    assert len({grip.share for grip in grips}) == 1


def test_each_pad_has_its_own_share(holds: dict[str, Hold]) -> None:
    """Across a body whose face towards y is slim, and the one behind it wide."""
    (grip,) = (each for each in holds["unlike"].grips if middle(holds["unlike"], each, "unlike")[0] == "y")
    assert grip.height_m is not None
    slim = on_face(middle(holds["unlike"], grip, "unlike")[1], grip.height_m, (-0.00775, 0.00775), WALL_M)
    plus_rad = holds["unlike"].yaw_rad + (np.pi / 2 if grip.faces == "y" else 0.0)
    assert grip.share[0 if np.sin(plus_rad) > 0 else 1] == pytest.approx(slim, abs=SHARE)
    assert grip.share[1 if np.sin(plus_rad) > 0 else 0] == pytest.approx(1.0, abs=SHARE)


def test_pads_are_on_faces_that_the_cuboid_has(holds: dict[str, Hold]) -> None:
    """Cuboids of bodies that are smaller than a pad are larger than they are, for it."""
    for hold in holds.values():
        for grip in hold.grips:
            assert grip.height_m is not None
            assert abs(grip.aside_m) + RADIUS_M <= hold.size_m[1 if grip.faces == "x" else 0] / 2 + 1e-9
            assert grip.height_m + RADIUS_M <= hold.size_m[2] + 1e-9


def test_a_place_at_which_pads_would_be_too_high_is_not_taken() -> None:
    """The better of two, on faces that lean by 30 degrees: its pads' middles are 55 mm over the wall."""
    lean, flat = np.radians(30.0), np.zeros((2, 2))
    places = Places(
        middle=np.array([[0.0, 0.0, 0.049], [0.0, 0.0, 0.03]]),
        yaw_rad=np.array([0.0, np.pi / 2]),
        width_m=np.array([0.05, 0.06]),
        tilt_rad=flat,
        lean_rad=np.array([[lean, lean], [0.0, 0.0]]),
        aside_rad=flat,
        coverage=np.array([[1.0, 1.0], [0.8, 0.9]]),
        body=np.zeros(2, dtype=np.int64),
    )
    points = trimesh.sample.sample_surface(box(0.06, 0.06, 0.07), 500, seed=1)[0] + [0.0, 0.0, 0.03]
    hold = hold_of("hold", points, places, ROBOT)
    assert isinstance(hold, Box)
    assert hold.yaw_rad == np.pi / 2
    assert hold.grips == (Grip("x", 0.0, 0.03, (0.8, 0.9)),)


@pytest.mark.sweep
def test_a_wall_of_partial_grips_is_planned_and_climbed(tmp_path: Path) -> None:
    """The holds of the shipped wall of one step, of which the goal's is slim and a start's low."""
    places = [(0.14, 0.36), (0.14, -0.36), (-0.14, 0.36), (-0.14, -0.36), (0.29, 0.36)]
    kinds = [(0.06, 0.06, 0.06), (0.06, 0.06, 0.033), (0.06, 0.06, 0.06), (0.06, 0.06, 0.06), (0.06, 0.0155, 0.06)]
    solids = [standing(*place, box(*size)) for place, size in zip(places, kinds, strict=True)]
    imported(tmp_path, solids, (0.9, 1.1))
    scenario = load_scenario(tmp_path / "wall.yaml")
    slim = next(hold for hold in scenario.holds if hold.position_m[0] > 0.25)
    (grip,) = slim.grips
    assert 0.7 < min(grip.share) < 0.82
    found = crux_planner.plan(scenario, ROBOT)
    gripped = [knot.limbs[0] for knot in found.plan.knots if knot.limbs[0].hold == scenario.hold_index(slim.name)]
    assert gripped
    assert [limb.friction for limb in gripped] == pytest.approx([min(grip.share) * 2.2] * len(gripped))
    assert min(pad_shares_of(found.plan)[scenario.hold_index(slim.name)]) == min(grip.share)
    climbs_and_replays(found, ROBOT, tmp_path / "log.mcap")
