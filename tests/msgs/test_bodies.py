"""Scenario files of version 2: the same wall as a file of version 1, and what is refused of them."""

from __future__ import annotations

import copy
import math
from typing import Any

import pytest
from crux_contracts.scenario import Scenario, ScenarioError, parse_scenario
from crux_contracts.scenario_document import change_friction
from test_schemas import read_schema, wrong

FIRST: dict[str, Any] = {
    "version": 1,
    "name": "wall",
    "robot": "scaler",
    "wall": {"slope_deg": 110, "friction": 0.5},
    "contact": {"model": "patch", "spine_shear_N": 5},
    "holds": [
        {"name": limb, "position_m": [x, y], "size_m": [0.09, 0.06, 0.05], "yaw_deg": 10, "friction": 2.0}
        for limb, x, y in (("LF", 0.14, 0.36), ("RF", 0.14, -0.36), ("LR", -0.14, 0.36), ("RR", -0.14, -0.36))
    ],
    "obstacles": [{"name": "pillar", "position_m": [0.6, 0.1], "size_m": [0.05, 0.05, 0.2], "yaw_deg": 30}],
    "start": {
        "body": {"position_m": [0, 0, 0.185]},
        "grasps": {limb: {"hold": limb, "faces": "x"} for limb in ("LF", "RF", "LR", "RR")},
    },
    "goal": {"body": {"position_m": [0.02, 0, 0.185]}},
    "horizon": {"steps": 20, "dt_s": 2},
}


PLANE = {"name": "wall", "plane": {"point_m": [0, 0, 0], "normal": [0, 0, 1]}, "friction": 0.5}
RECTANGLE = {"pose": {"position_m": [0.3, 1.0, 0.5], "rpy_deg": [90, 0, 0]}, "size_m": [2.0, 1.0], "depth_m": 0.1}
SIDE = {"name": "side", "rectangle": RECTANGLE, "friction": 0.8}


def body(old: dict[str, Any]) -> dict[str, Any]:
    rest = {key: old[key] for key in ("name", "friction") if key in old}
    pose = {"position_m": [*old["position_m"], 0.0], "rpy_deg": [0, 0, old["yaw_deg"]]}
    return rest | {"pose": pose, "shape": {"box_m": old["size_m"]}}


def second() -> dict[str, Any]:
    slope = math.radians(FIRST["wall"]["slope_deg"])
    wall = {key: copy.deepcopy(value) for key, value in FIRST.items() if key != "wall"}
    return wall | {
        "version": 2,
        "gravity_m_s2": [-9.81 * math.sin(slope), 0.0, -9.81 * math.cos(slope)],
        "surfaces": [copy.deepcopy(PLANE)],
        "holds": [body(each) for each in FIRST["holds"]],
        "obstacles": [body(each) for each in FIRST["obstacles"]],
    }


def parts(scenario: Scenario) -> dict[str, Any]:
    return {key: value for key, value in vars(scenario).items() if key not in ("yaml_text", "wall")}


def test_the_same_wall_reads_the_same() -> None:
    old, new = parse_scenario(FIRST), parse_scenario(second())
    assert parts(old) == parts(new)
    assert new.wall.gravity_w_m_s2 == pytest.approx(old.wall.gravity_w_m_s2)
    assert new.wall.slope_deg == pytest.approx(110.0)
    assert new.wall.friction == 0.5


def test_faces_lean_and_gravity_points_anywhere() -> None:
    wall = second()
    wall["gravity_m_s2"] = [1.0, -2.0, 0.5]
    wall["holds"][1]["shape"]["lean_deg"] = {"+x": 30, "-y": 15}
    read = parse_scenario(wall)
    assert read.wall.gravity_w_m_s2 == (1.0, -2.0, 0.5)
    assert read.leans
    assert [hold.leans for hold in read.holds] == [False, True, False, False]
    assert read.holds[1].lean_rad == pytest.approx(tuple(map(math.radians, (30, 0, 0, 15))))


def test_holds_have_places_for_grippers() -> None:
    wall = second()
    wall["holds"][1]["grips"] = [{"faces": "y", "aside_m": -0.01, "height_m": 0.03}]
    read = parse_scenario(wall)
    assert read.holds[0].places("x") == (None,)
    assert (read.holds[1].places("x"), read.holds[1].places("y")) == ((), read.holds[1].grips)
    assert read.holds[1].grips[0].aside_m == -0.01
    schema = read_schema("scenario-2.json")
    assert wrong(schema, wall) == []
    wall["holds"][1]["grips"][0]["faces"] = "z"
    assert wrong(schema, wall) == [".holds[1].grips[0].faces"]


def test_a_grip_may_have_a_friction_of_its_own() -> None:
    wall, schema = second(), read_schema("scenario-2.json")
    wall["holds"][1]["friction"] = {"+x": 1.0, "-x": 1.1, "+y": 1.2, "-y": 1.3, "top": 0.1}
    for given, read in (([0.5, 0.6], (1.0, 1.1, 0.5, 0.6, 0.1)), (0.7, (1.0, 1.1, 0.7, 0.7, 0.1))):
        wall["holds"][1]["grips"] = [{"faces": "y", "friction": given}, {"faces": "x"}]
        assert parse_scenario(wall).holds[1].friction == read
        assert wrong(schema, wall) == []
    for bad in ([0.5], [0.5, 9.0], "rough"):
        wall["holds"][1]["grips"] = [{"faces": "y", "friction": bad}]
        assert wrong(schema, wall) == [".holds[1].grips[0].friction"]
        with pytest.raises(ScenarioError, match=r"grips\[0\].friction"):
            parse_scenario(wall)


def test_friction_is_changed_on_faces_and_grips_alike() -> None:
    for faces in (2.0, {"+x": 2.0, "-x": 2.0, "+y": 2.0, "-y": 2.0, "top": 2.0}):
        wall = second()
        wall["holds"][1] |= {"friction": faces, "grips": [{"faces": "x", "friction": [1.0, 1.6]}, {"faces": "y"}]}
        change_friction(wall["holds"][1], lambda each: each / 2)
        assert parse_scenario(wall).holds[1].friction == (0.5, 0.8, 1.0, 1.0, 1.0)
    del wall["holds"][1]["grips"]
    change_friction(wall["holds"][1], lambda each: each / 2)
    assert parse_scenario(wall).holds[1].friction == (0.5,) * 5


def test_bodies_are_turned_out_of_the_walls_plane() -> None:
    wall = second()
    wall["obstacles"][0]["pose"] = {"position_m": [0.6, 0.1, 0.03], "rpy_deg": [80, -100, 20]}
    wall["holds"][2]["pose"] = {"position_m": [-0.14, 0.36, 0.02], "rpy_deg": [10, -20, 5]}
    read = parse_scenario(wall)
    assert read.obstacles[0].tilt_rad == pytest.approx((math.radians(80), math.radians(-100)))
    assert [hold.turned for hold in read.holds] == [False, False, True, False]
    assert read.holds[2].foot_z_m == 0.02
    assert read.tilts
    assert read.not_upright == "LR is turned out of the wall's plane"


def test_surfaces_are_bounded_by_the_solids_behind_them() -> None:
    """A side wall at y = 1 which looks to the right, and the plane of W or not."""
    wall = second()
    wall["surfaces"].append(SIDE)
    read = parse_scenario(wall).wall
    (slab,) = read.slabs
    assert read.endless
    assert (slab.name, slab.friction, slab.size_m) == ("side", 0.8, (2.0, 1.0, 0.1))
    assert (*slab.position_m, slab.foot_z_m) == pytest.approx((0.3, 1.1, 0.5))  # its foot is behind it
    assert slab.tilt_rad == pytest.approx((math.pi / 2, 0.0))
    assert parse_scenario(wall).not_upright == "the surface side is bounded"
    wall["surfaces"].pop(0)
    assert not parse_scenario(wall).wall.endless


def test_what_stands_on_a_turned_face_is_not_in_it() -> None:
    """A hold on the face of a volume that is turned by 30 degrees, at places rounded as files have them."""
    wall, turn = second(), math.radians(30)
    wall["obstacles"][0] = {
        "name": "volume",
        "pose": {"position_m": [0.6, 0.1, 0.0], "rpy_deg": [0, 30, 0]},
        "shape": {"box_m": [0.3, 0.3, 0.1]},
    }
    on_face = [round(0.6 + 0.1 * math.sin(turn), 4), 0.1, round(0.1 * math.cos(turn), 4)]
    wall["holds"][0] |= {"pose": {"position_m": on_face, "rpy_deg": [0, 30, 0]}}
    parse_scenario(wall)
    wall["holds"][0]["pose"]["position_m"][2] -= 0.004
    with pytest.raises(ScenarioError, match=r'"volume" overlaps "LF" \(.*by 0.0034'):
        parse_scenario(wall)


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [
        (("holds", 1, "pose", "rpy_deg"), [100, 0, 0], "holds[1].pose.rpy_deg: roll 100, pitch 0: is not supported"),
        (("holds", 1, "pose", "rpy_deg"), [80, 130, 0], "is turned by 96 degrees out of the wall's plane, expected at"),
        (("holds", 0, "pose", "position_m"), [0.14, 0.36, -0.06], "LF ends -10.0 mm off the wall"),
        (
            ("holds", 0, "pose"),
            {"position_m": [0.14, 0.36, 0], "rpy_deg": [0, 9, 0]},
            "shape.lean_deg: is not supported",
        ),
        (
            ("surfaces", 0, "plane", "normal"),
            [1, 0, 0],
            "plane.normal: [1.0, 0.0, 0.0]: expected [0, 0, 1]",
        ),
        (("surfaces", 0, "plane", "point_m"), [0, 0, 1], "surfaces[0].plane.point_m: z 1: expected z 0, or a rect"),
        (("surfaces",), [], "surfaces: a list of 0: expected at least one"),
        (("surfaces", 0), {"name": "wall"}, "surfaces[0]: a mapping: expected either plane or rectangle"),
        (("surfaces", 0, "rectangle"), RECTANGLE, "surfaces[0]: a mapping: expected either plane or rectangle"),
        (("surfaces",), [PLANE, PLANE | {"name": "b"}], "surfaces[1].plane: another surface is the plane z = 0 of W"),
        (("surfaces",), [PLANE, SIDE | {"name": "wall"}], "surfaces[1].name: wall: expected a name of its own"),
        (("contact",), {"model": "point"}, "surfaces[0].rectangle: does not go with contact.model point"),
        (("holds", 2, "shape", "lean_deg"), {"+y": 45, "-y": 45}, "leaves -40.0 mm along y at the top of LR"),
        (("holds", 2, "shape", "lean_deg"), {"+y": 60}, "expected a number in 0..50 degrees"),
        (("obstacles", 0, "shape", "lean_deg"), {"+y": 10}, "obstacles[0].shape.lean_deg: is for holds"),
        (
            ("holds", 2, "grips"),
            [{"faces": "x"}, {"faces": "y", "share": [0.5, 1.0]}, {"faces": "x", "friction": 1.0}],
            "grips: those of LR on faces x differ in share or friction; expected the same",
        ),
        (("start", "grasps", "RF", "grip"), 0, "RF.grip: 0: expected less than 0: the hold has so many grips on faces"),
        (
            ("goal", "grasps"),
            {"RF": {"hold": "RF", "faces": "x", "grip": 0}},
            "RF.grip: 0: is for starts: a goal",
        ),
        (("holds", 2, "grips"), [{"faces": "z"}], 'holds[2].grips[0].faces: "z": expected x or y'),
        (("holds", 2, "grips"), [{"faces": "x", "height_m": 35}], "height_m: 35: expected a number in 0.005..2 m"),
        (("obstacles", 0, "grips"), [{"faces": "x"}], "obstacles[0].grips: unknown key"),
        (("gravity_m_s2",), [0, 0, 0], "expected a vector that is not 0"),
        (("wall",), {"slope_deg": 90}, "wall: unknown key"),
        (("holds", 0, "pose", "position_m"), [-0.14, 0.36, 0], '"LR" overlaps "LF"'),
    ],
)
def test_what_cannot_be_is_named(place: tuple[Any, ...], value: Any, says: str) -> None:
    wall: Any = second()
    if "point" in says and "contact" in says:
        wall["surfaces"] = [copy.deepcopy(SIDE)]
    if "shape.lean_deg" in says:
        wall["holds"][0]["shape"]["lean_deg"] = {"+x": 10}
    part = wall
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    with pytest.raises(ScenarioError) as error:
        parse_scenario(wall)
    assert says in str(error.value)


def test_the_schema_takes_it_and_refuses_what_the_reader_refuses() -> None:
    schema = read_schema("scenario-2.json")
    assert wrong(schema, second()) == []
    assert wrong(schema, second() | {"surfaces": []}) == []
    assert wrong(schema, second() | {"wall": {"slope_deg": 90}}) == [".wall"]
    steep = second()
    steep["holds"][0]["shape"]["lean_deg"] = {"+x": 60}
    assert wrong(schema, steep) == [".holds[0].shape.lean_deg.+x"]


FEET = [{"name": "near", "position_m": [-0.14, 0.3, 0.0005]}, {"name": "side-on", "position_m": [0.3, 1.0, 0.2]}]


def on_feet() -> dict[str, Any]:
    """The wall with a surface at its side, and feet on both."""
    wall = second()
    wall["surfaces"].append(copy.deepcopy(SIDE))
    wall["footholds"] = copy.deepcopy(FEET)
    wall["start"]["grasps"]["LR"] = {"foothold": "near"}
    wall["goal"]["grasps"] = {"LF": {"foothold": "side-on"}, "LR": {"hold": "LR", "faces": "x"}}
    return wall


def test_limbs_may_stand_on_surfaces() -> None:
    read = parse_scenario(on_feet())
    near, side = read.footholds
    assert (near.friction, near.position_m, near.rpy_deg, near.surface) == (0.5, (-0.14, 0.3, 0.0), (0.0, 0.0, 0.0), "")
    assert (side.friction, side.rpy_deg, side.surface) == (0.8, (90.0, 0.0, 0.0), "side")
    assert side.position_m == pytest.approx((0.3, 1.0, 0.2))
    assert (read.start.grasps["LR"].foothold, read.start.grasps["LF"].foothold) == ("near", "")
    assert read.place_index(read.goal.grasps["LF"]) == len(read.cuboids) + 1
    assert read.not_upright
    assert wrong(read_schema("scenario-2.json"), on_feet()) == []


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [
        (("footholds", 0, "position_m"), [0.1, 0.2, 0.002], "[0.1, 0.2, 0.002]: is on no surface; expected one within"),
        (("footholds", 1, "position_m"), [0.3, 1.0, 1.1], "is on no surface; expected one within 1 mm; side is 100 mm"),
        (("footholds", 1, "position_m"), [0.3, 1.0], "footholds[1].position_m: a list of 2: expected a list of 3"),
        (("footholds", 1, "name"), "near", "footholds[1].name: \"near\": expected a name of its own"),
        (("footholds", 1, "name"), "LF", "footholds[1].name: \"LF\": expected a name of its own"),
        (("footholds", 0, "friction"), 0.5, "footholds[0].friction: unknown key"),
        (("start", "grasps", "LR"), {"foothold": "nearer"}, "no such foothold; did you mean near?"),
        (("start", "grasps", "LR"), {"foothold": "LR"}, "no such foothold; expected near or side-on"),
        (("start", "grasps", "RR"), {"foothold": "near"}, "expected a foothold of its own for RR; LR has this one"),
        (("start", "grasps", "RR"), {"hold": "near", "faces": "x"}, "no such hold"),
        (("start", "grasps", "LR"), {"foothold": "near", "faces": "x"}, "start.grasps.LR.faces: unknown key"),
        (("contact",), {"model": "point"}, "footholds: a list of 2: does not go with contact.model point"),
    ],
)  # fmt: skip
def test_what_feet_cannot_stand_on_is_named(place: tuple[str | int, ...], value: Any, says: str) -> None:
    wall: Any = on_feet()
    at = wall
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value
    with pytest.raises(ScenarioError) as raised:
        parse_scenario(wall)
    assert says in str(raised.value)


def test_files_of_version_1_have_no_footholds() -> None:
    for change, says in (
        ({"footholds": FEET}, "footholds: unknown key"),
        ({"start": FIRST["start"] | {"grasps": {"LF": {"foothold": "near"}}}}, "start.grasps.LF.foothold: unknown key"),
    ):
        with pytest.raises(ScenarioError, match="unknown key") as raised:
            parse_scenario(copy.deepcopy(FIRST) | change)
        assert says in str(raised.value)
        assert wrong(read_schema("scenario.json"), FIRST | change)
