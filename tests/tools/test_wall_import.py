"""`crux wall import`: solids of known shape, scanned in any frame, become the holds they are, and others say why."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from climbs import climb_here
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.method_report import wall_offers
from crux_simulation.wall.edit.content import scenario_of
from crux_simulation.wall.read import read_surface
from crux_tools.cli import main
from crux_tools.paths import SCENARIOS
from PIL import Image, TiffImagePlugin

TURN = trimesh.transformations.euler_matrix(0.4, -1.1, 0.7)  # of the wall in its scan
UP, OUT = TURN[:3, 0], TURN[:3, 2]


def standing(x: float, y: float, solid: trimesh.Trimesh, yaw_deg: float = 0.0) -> trimesh.Trimesh:
    """A solid, its foot sunk a little into the wall."""
    turn = trimesh.transformations.rotation_matrix(np.radians(yaw_deg), [0, 0, 1])
    turn[:3, 3] = [x, y, -0.005 - solid.bounds[0, 2]]
    return solid.copy().apply_transform(turn)


def box(*size_m: float) -> trimesh.Trimesh:
    return trimesh.creation.box((*size_m[:2], size_m[2] + 0.005))


def leaning(foot_m: float, height_m: float, degrees: float) -> trimesh.Trimesh:
    """A frustum on a square foot, its sides so far from upright."""
    top = foot_m / 2.0 - height_m * np.tan(np.radians(degrees))
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return trimesh.convex.convex_hull(
        np.vstack(
            [np.column_stack([half * corners, np.full(4, z)]) for half, z in ((foot_m / 2.0, 0.0), (top, height_m))]
        )
    )


BODIES = {  # by name: the solid, and what is said of it at 15 and at 32 degrees of leaning; "" is a hold
    "cube": (standing(-0.3, 0.2, box(0.06, 0.06, 0.06), 20.0), "", ""),
    "ledge": (standing(-0.3, -0.1, box(0.12, 0.03, 0.06), -35.0), "", ""),
    "thin": (standing(-0.05, 0.25, box(0.012, 0.012, 0.06)), "narrower", "narrower"),
    "wide": (standing(0.0, -0.15, box(0.15, 0.15, 0.06)), "wider", "wider"),
    "low": (standing(0.25, 0.25, box(0.06, 0.06, 0.018)), "too low", "too low"),
    "slim": (standing(-0.1, -0.25, box(0.06, 0.009, 0.06)), "less than 0.5 of a pad", "less than 0.5 of a pad"),
    "leaning": (standing(0.25, -0.05, leaning(0.09, 0.05, 28.0)), "lean", ""),
    "post": (standing(0.3, -0.25, trimesh.creation.cylinder(0.012, 0.06)), "round", "round"),
    "beside": (standing(0.1, 0.12, box(0.05, 0.05, 0.06)), "beside", "beside"),
    "neighbours": (
        trimesh.util.concatenate(
            [
                standing(0.1 + a, 0.12 + b, box(0.03, 0.03, 0.06))
                for a, b in ((0.054, 0), (-0.054, 0), (0, 0.054), (0, -0.054))
            ]
        ),
        "",
        "",
    ),
}
PLACES = {name: body[0].bounds.mean(axis=0)[:2] for name, body in BODIES.items() if name != "neighbours"}


def scan(folder: Path, bodies: list[trimesh.Trimesh], size_m: tuple[float, float], name: str = "scan.ply") -> Path:
    slab = trimesh.creation.box((*size_m, 0.1), trimesh.transformations.translation_matrix([0, 0, -0.05]))
    mesh = trimesh.util.concatenate([slab, *bodies])
    mesh.apply_transform(TURN)
    mesh.export(folder / name)
    return folder / name


def wall_import(capsys: pytest.CaptureFixture[str], *words: str, status: int = 0) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["wall", "import", *words, "--json"]) == status
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    return said


def vector(values: np.ndarray) -> list[str]:
    return [f"{value:.9f}" for value in values]


@pytest.mark.parametrize(("tilt_deg", "which"), [(15, 1), pytest.param(32, 2, marks=pytest.mark.sweep)])
def test_each_body_is_what_it_is(tilt_deg: int, which: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall, path = tmp_path / "wall.yaml", scan(tmp_path, [body[0] for body in BODIES.values()], (0.9, 0.7))
    down = -(np.sin(np.radians(50.0)) * UP + np.cos(np.radians(50.0)) * OUT)
    frame = ["--outward", *vector(OUT), "--down", *vector(down)]
    said = wall_import(capsys, str(path), "-o", str(wall), *frame, "--tilt", str(tilt_deg), status=1)
    assert said["slope_deg"] == pytest.approx(50.0, abs=0.01)
    assert np.array(said["rotation"]) == pytest.approx(TURN[:3, :3].T, abs=1e-3)
    found = said["bodies"]
    for name, place in PLACES.items():
        body = min(found, key=lambda each: float(np.linalg.norm(np.subtract(each["position_m"], place))))
        assert np.linalg.norm(np.subtract(body["position_m"], place)) < 0.004
        reason = BODIES[name][which]
        assert isinstance(reason, str)
        assert body["hold"] is (not reason), (name, body)
        assert reason in (body["reason"] or ""), (name, body)
    assert yaml.safe_load(wall.read_text(encoding="utf-8"))["version"] == (2 if tilt_deg > 28 else 1)
    holds = [each for each in found if each["hold"]]
    cube, frustum = (
        min(holds, key=lambda each: float(np.linalg.norm(np.subtract(each["position_m"], PLACES[name]))))
        for name in ("cube", "leaning")
    )
    written = {each["name"]: each for each in yaml.safe_load(wall.read_text(encoding="utf-8"))["holds"]}
    assert cube["size_m"] == pytest.approx([0.06, 0.06, 0.06], abs=1e-3)
    assert (cube["yaw_deg"] - 20.0 + 1.0) % 90.0 == pytest.approx(1.0, abs=0.3)
    assert written[cube["name"]]["friction"] == {"+x": 2.2, "-x": 2.2, "+y": 2.2, "-y": 2.2, "top": 0.0}
    if tilt_deg > 28:
        shape = written[frustum["name"]]["shape"]
        foot_m = 0.09 - 0.01 * np.tan(np.radians(28.0))  # it is sunk by 5 mm
        assert shape["box_m"][:2] == pytest.approx([foot_m, foot_m], abs=2e-3)
        assert shape["lean_deg"] == pytest.approx(dict.fromkeys(("+x", "-x", "+y", "-y"), 28.0), abs=1.0)
        assert written[frustum["name"]]["friction"]["+x"] == pytest.approx(2.2, abs=0.1)


def test_a_wall_without_a_pair_of_faces_is_all_obstacles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scan(tmp_path, [standing(0.0, 0.0, box(0.15, 0.15, 0.06))], (0.4, 0.4))
    said = wall_import(capsys, str(path), "-o", str(tmp_path / "wall.yaml"), "--outward", *vector(OUT), status=1)
    assert [(body["hold"], body["reason"]) for body in said["bodies"]] == [(False, "wider than the gripper opens")]
    assert said["without_start"] == "no level body has four holds in reach"


def test_a_hold_is_not_in_the_way_of_its_own_fingers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its faces lean by 40 degrees: below the pads they come 10 mm nearer to the fingers."""
    path = scan(tmp_path, [standing(0.0, 0.0, leaning(0.13, 0.05, 40.0))], (0.4, 0.4))
    words = ["--outward", *vector(OUT), "--tilt", "45"]
    hold, *others = wall_import(capsys, str(path), "-o", str(tmp_path / "wall.yaml"), *words, status=1)["bodies"]
    assert hold["hold"]
    along, across = np.meshgrid(np.linspace(0.012, 0.036, 9), np.linspace(-0.012, 0.012, 9))
    lanes = [np.column_stack([side * (hold["size_m"][0] / 2 + along.ravel()), across.ravel()]) for side in (1, -1)]
    fingers = np.concatenate(lanes) @ turned(hold["yaw_deg"]).T + hold["position_m"]
    for other in others:
        inside = np.abs((fingers - other["position_m"]) @ turned(other["yaw_deg"])) < np.divide(other["size_m"][:2], 2)
        assert not inside.all(axis=1).any(), other


def test_a_pair_of_faces_that_the_planner_does_not_grip_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A post is 15 mm beside the middle of a finger's way, plans keep 18 mm off."""
    parts = [standing(0.0, 0.0, box(0.06, 0.024, 0.06)), standing(0.052, 0.0195, box(0.012, 0.009, 0.06))]
    path, wall, robot = scan(tmp_path, parts, (0.4, 0.4)), tmp_path / "wall.yaml", load_robot("scaler")
    wall_import(capsys, str(path), "-o", str(wall), "--outward", *vector(OUT), status=1)
    report = wall_offers(scenario_of(yaml.safe_load(wall.read_text(encoding="utf-8")), robot, "wall"), robot)
    (hold,) = yaml.safe_load(wall.read_text(encoding="utf-8"))["holds"]
    (gripped,) = (pair.faces for pair in report.pairs if not pair.reason)
    assert hold["size_m"]["xy".index(gripped)] == pytest.approx(0.024, abs=1e-3)
    assert {face[1] for face, friction in hold["friction"].items() if friction > 0.0} == {gripped}


def test_a_heap_of_bodies_is_few_obstacles_that_cover_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """So many that real walls stay within a scenario's limit; apart, else it would not load."""
    random = np.random.default_rng(3)
    corners = [(x, y) for x in (-0.12, 0.0, 0.12) for y in (-0.12, 0.0, 0.12)]
    solids = [standing(x, y, box(0.15, 0.05, 0.018), float(random.uniform(0, 180))) for x, y in corners]
    path = scan(tmp_path, solids, (0.5, 0.5))
    words = ["--outward", *vector(OUT), "--down", *vector(-UP)]
    found = wall_import(capsys, str(path), "-o", str(tmp_path / "wall.yaml"), *words, status=1)["bodies"]
    assert not any(body["hold"] for body in found)
    assert len(found) <= 3 * len(solids), len(found)
    tops = np.concatenate([trimesh.sample.sample_surface(solid, 200, seed=1)[0] for solid in solids])
    off = [
        (np.abs((tops[:, :2] - body["position_m"]) @ turned(body["yaw_deg"])) - np.divide(body["size_m"][:2], 2)).max(
            axis=1
        )
        for body in found
    ]
    assert np.mean(np.min(off, axis=0) < 0.0065) > 0.99


def turned(yaw_deg: float) -> np.ndarray:
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    return np.array([[c, -s], [s, c]])


def of_scene(folder: Path, name: str) -> tuple[Path, dict[str, Any]]:
    scene = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text(encoding="utf-8"))
    solids = [standing(hold["position_m"][0], hold["position_m"][1], box(*hold["size_m"])) for hold in scene["holds"]]
    return scan(folder, solids, (0.9, 1.0), "scan.stl"), scene


@pytest.mark.sweep
def test_a_scanned_wall_is_planned_and_climbed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, scene = of_scene(tmp_path, "climb-four-holds")
    wall, plan, picture = tmp_path / "wall.yaml", tmp_path / "plan.mcap", tmp_path / "wall.png"
    down = -(np.sin(np.radians(45.0)) * UP + np.cos(np.radians(45.0)) * OUT)
    frame = ["--outward", *vector(OUT), "--down", *vector(down), "--picture", str(picture)]
    said = wall_import(capsys, str(path), "-o", str(wall), *frame)
    assert all(body["hold"] for body in said["bodies"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    read = load_scenario(wall)
    given = np.array([hold["position_m"] for hold in scene["holds"]])
    for hold in read.holds:
        assert np.linalg.norm(given - hold.position_m, axis=1).min() < 0.002
        assert hold.size_m == pytest.approx((0.06, 0.06, 0.06), abs=1e-3)
    assert {limb: grasp.hold for limb, grasp in read.start.grasps.items()} != {
        limb: grasp.hold for limb, grasp in read.goal.grasps.items()
    }
    assert main(["plan", str(wall), "-o", str(plan)]) == 0
    status, climbed = climb_here(plan, tmp_path / "log.mcap")
    assert (status, climbed["slips"], climbed["fell"]) == (0, 0, False)


def height_map(folder: Path, **arrays: np.ndarray) -> Path:
    np.savez(folder / "map.npz", **arrays)  # type: ignore[arg-type]
    return folder / "map.npz"


def test_a_height_map_may_say_its_unit_and_its_places(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    x, y = np.arange(-0.15, 0.15, 0.0025), np.arange(-0.15, 0.15, 0.0025)
    heights = 500.0 * ((abs(x[None]) < 0.03) & (abs(y[:, None]) < 0.03))
    heights[0, :5] = np.iinfo(np.int16).min  # unseen
    path = height_map(tmp_path, z_tenth_mm=heights.astype(np.int16), x_m=x, y_m=y)
    (body,) = wall_import(capsys, str(path), "-o", str(tmp_path / "wall.yaml"), status=1)["bodies"]
    assert body["hold"]
    assert sorted(body["size_m"]) == pytest.approx([0.05, 0.06, 0.06], abs=0.006)


def test_a_geotiff_says_its_pitch_and_what_is_unseen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """x of the image is 0.002 and y 0.003 m from pixel to pixel; its first row is the top."""
    x, y = 0.002 * np.arange(150), 0.003 * np.arange(100)
    heights = 0.05 * ((abs(x[None] - 0.1) < 0.03) & (abs(y[:, None] - 0.15) < 0.045))
    heights[:5, -40:] = -9999.0
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, kind, value in ((33550, 12, (0.002, 0.003, 0.0)), (42113, 2, "-9999")):
        tags.tagtype[tag], tags[tag] = kind, value
    Image.fromarray(heights[::-1].astype(np.float32)).save(tmp_path / "map.tif", tiffinfo=tags)
    said = wall_import(capsys, str(tmp_path / "map.tif"), "-o", str(tmp_path / "wall.yaml"), status=1)
    (body,) = said["bodies"]
    assert body["hold"]
    assert sorted(body["size_m"]) == pytest.approx([0.05, 0.06, 0.09], abs=0.006)
    surface = read_surface(tmp_path / "map.tif", 1.0, None, np.array([0.0, 0.0, 1.0]))
    assert surface.vertices[:, 2].min() == 0.0
    assert surface.vertices.max(axis=0) == pytest.approx([x[-1], y[-1], 0.05])
    assert not ((surface.vertices[:, 0] > x[-39]) & (surface.vertices[:, 1] < y[4])).any()


def plane(count: int, pitch_m: float) -> np.ndarray:
    x, y = np.meshgrid(*[pitch_m * np.arange(count)] * 2)
    return np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3)


def pcd(path: Path, points: np.ndarray, form: str, lost: int = 0) -> None:
    """Points with a field before and one after, of which the last `lost` bytes are missing."""
    header = "# .PCD v0.7\nVERSION 0.7\nFIELDS normal x y z rgb\nSIZE 4 8 4 4 4\nTYPE F F F F U\nCOUNT 3 1 1 1 1\n"
    header += f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {form}\n"
    if form == "ascii":
        body = "".join(f"7 8 9 {x} {y} {z} 10\n" for x, y, z in points).encode()
    else:
        rows = np.zeros(len(points), [("n", "<f4", 3), ("x", "<f8"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
        rows["x"], rows["y"], rows["z"], rows["n"] = *points.T, 7.0
        body = rows.tobytes()
    path.write_bytes(header.encode() + body[: len(body) - lost])


def test_every_kind_of_cloud_gives_the_same_surface(tmp_path: Path) -> None:
    points = plane(100, 0.003)
    points[(np.abs(points[:, :2] - 0.15) < 0.03).all(axis=1), 2] = 0.004
    trimesh.PointCloud(points).export(tmp_path / "a.ply")
    trimesh.PointCloud(points).export(tmp_path / "a.xyz")
    np.savez(tmp_path / "a.npz", xyz_m=points, normal=np.zeros_like(points))
    unseen = np.vstack([points, np.full((5, 3), np.nan)])
    for form in ("ascii", "binary"):
        pcd(tmp_path / f"{form}.pcd", unseen, form)
    for name in ("a.ply", "a.xyz", "a.npz", "ascii.pcd", "binary.pcd"):
        surface = read_surface(tmp_path / name, 1.0, None, np.array([0.3, 0.0, 1.0]))
        inner = surface.vertices[(np.abs(surface.vertices[:, :2] - 0.15) < 0.02).all(axis=1)]
        assert inner[:, 2] == pytest.approx(0.004, abs=1e-5), name
        assert surface.mesh.area == pytest.approx(0.3**2, rel=0.05), name
        assert np.mean(surface.mesh.face_normals[:, 2] > 0.0) > 0.99, name


def test_a_boards_table_is_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"h{i},{x},{y},20" for i, (x, y) in enumerate((x, y) for x in (0.0, 0.28, 0.43) for y in (0.36, -0.36))]
    (tmp_path / "board.csv").write_text("\n".join(["# by hand", "cell,x_up_m_measured,y_left_m,up_deg", *rows]))
    said = wall_import(capsys, str(tmp_path / "board.csv"), "-o", str(tmp_path / "wall.yaml"), "--slope", "130")
    assert [body["name"] for body in said["bodies"]] == [f"h{i}" for i in range(6)]
    wall = load_scenario(tmp_path / "wall.yaml")
    assert wall.wall.slope_deg == 130.0
    assert [hold.yaw_deg for hold in wall.holds] == [20.0] * 6
    slick = ["-o", str(tmp_path / "wall.yaml"), "--slope", "130", "--friction", "0.05"]
    why = wall_import(capsys, str(tmp_path / "board.csv"), *slick, status=1)["without_start"]
    assert "can be a start; the first: " in why
    assert "give the grasped faces more friction" in why
    for line, wrong in (("h9,0.1,zero,0", "board.csv:3: y_left_m: 'zero'"), ("h9,0.1,0", "board.csv:3: 3 values")):
        (tmp_path / "board.csv").write_text("\n".join(["# by hand", "cell,x_up_m,y_left_m,up_deg", line]))
        assert main(["wall", "import", str(tmp_path / "board.csv"), "-o", str(tmp_path / "wall.yaml")]) == 2
        assert wrong in capsys.readouterr().err


def board(path: Path, *rows_m: float) -> Path:
    """A hold left and right in every row."""
    rows = [f"h{i},{x},{y}" for i, (x, y) in enumerate((x, y) for x in rows_m for y in (0.36, -0.36))]
    path.write_text("\n".join(["cell,x_up_m,y_left_m", *rows]), encoding="utf-8")
    return path


def test_the_goal_is_one_to_which_holds_lead(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two rows far above, on which a body could stand, are out of the limbs' reach; nearer ones are not."""
    words = ["-o", str(tmp_path / "wall.yaml"), "--slope", "60"]
    said = wall_import(capsys, str(board(tmp_path / "far.csv", 0.0, 0.28, 1.5, 1.78)), *words, status=1)
    assert "LF has no other hold in reach while the others hold on" in said["without_start"]
    assert "start" not in yaml.safe_load((tmp_path / "wall.yaml").read_text(encoding="utf-8"))
    wall_import(capsys, str(board(tmp_path / "near.csv", 0.0, 0.28, 0.43, 0.71)), *words)
    wall = load_scenario(tmp_path / "wall.yaml")
    assert {grasp.hold for grasp in wall.goal.grasps.values()} == {"h4", "h5", "h6", "h7"}
    assert main(["plan", str(tmp_path / "wall.yaml"), "-o", str(tmp_path / "plan.mcap")]) == 0


@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("none.ply", [], "no such file"),
        ("wall.step", [], ".step: expected one of .stl"),
        ("bad.ply", [], "cannot be read as a mesh"),
        ("cloud.ply", [], "has 3 points and no triangles"),
        ("triangle.ply", [], "3 vertices: expected a wall and what stands on it"),
        ("sparse.xyz", [], "its points are 0.044 m apart, expected at most 0.008 m"),
        ("heap.xyz", [], "has 2 points and no triangles"),
        ("short.pcd", [], "cannot be read as a PCD file: buffer is smaller"),
        ("packed.pcd", [], "DATA binary_compressed: expected ascii or binary; make it binary: pcl_convert_pcd"),
        ("none.pcd", [], "has no line DATA: is no PCD file"),
        ("large.stl", [], "is 900 m across, expected 0.2 to 40 m; looks like millimetres: --scale 0.001?"),
        ("map.npy", [], "give --pitch"),
        ("three.npy", ["--pitch", "0.01"], "shape (2, 2, 2)"),
        ("large.stl", ["--scale", "0.001", "--outward", "0", "0", "0"], "points nowhere"),
        ("large.stl", ["--tilt", "60"], "expected 0 to 50 degrees"),
    ],
)
def test_what_cannot_be_read_says_what_would_be_right(
    name: str, words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "wall.step").write_bytes(b"ISO-10303-21;")
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat ascii 9\n")
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "cloud.ply")
    trimesh.Trimesh(np.eye(3), [[0, 1, 2]]).export(tmp_path / "triangle.ply")
    trimesh.PointCloud(plane(21, 0.05)).export(tmp_path / "sparse.xyz")
    trimesh.PointCloud(np.repeat([[0, 0, 0], [0.3, 0, 0]], 60, axis=0)).export(tmp_path / "heap.xyz")
    pcd(tmp_path / "short.pcd", np.zeros((9, 3)), "binary", lost=4)
    pcd(tmp_path / "packed.pcd", np.zeros((9, 3)), "binary_compressed")
    (tmp_path / "none.pcd").write_bytes(b"VERSION 0.7\n")
    trimesh.creation.box((900.0, 800.0, 10.0)).export(tmp_path / "large.stl")
    np.save(tmp_path / "map.npy", np.zeros((4, 5)))
    np.save(tmp_path / "three.npy", np.zeros((2, 2, 2)))
    try:
        status = main(["wall", "import", str(tmp_path / name), "-o", str(tmp_path / "wall.yaml"), *words])
    except SystemExit as usage:
        status = int(usage.code or 0)
    assert status == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "wall.yaml").exists()
