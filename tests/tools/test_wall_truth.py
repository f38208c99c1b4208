"""`crux wall import` against walls whose grips are known by construction, as meshes and as clouds of points."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh
from crux_contracts.robot import Robot, load_robot
from crux_simulation.wall.frame import Placed, placed
from crux_simulation.wall.places import Limits, Places, bodies, find_places
from crux_simulation.wall.planes import planes
from crux_simulation.wall.read import read_surface
from scipy.optimize import linprog

ROBOT = load_robot("scaler")
UPRIGHT = np.array([0.0, 0.0, 1.0])
SPACING_M = 0.0025  # of the points of clouds
PLACES_M = [(x, y) for x in (-0.2, 0.0, 0.2) for y in (-0.2, 0.0, 0.2)]
SLAB_M = (0.64, 0.64)
SUNK_M = 0.01
COVERAGE = 0.8  # of the pads of grips that count here


@dataclasses.dataclass(frozen=True)
class Prism:
    """A convex solid on the wall: polygon (k, 2) at its foot and at its top [m], its height, and, by pair of opposite
    sides, whether the gripper can take it.
    """

    foot: np.ndarray
    top: np.ndarray
    height_m: float
    graspable: dict[int, bool]

    @property
    def mesh(self) -> trimesh.Trimesh:
        deep = self.foot + (self.foot - self.top) * SUNK_M / self.height_m
        rings = [
            np.column_stack([ring, np.full(len(ring), z)]) for ring, z in ((deep, -SUNK_M), (self.top, self.height_m))
        ]
        return trimesh.convex.convex_hull(np.vstack(rings))

    def pair(self, side: int) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Middle (2,) and direction (2,) of the axis through a side and the one opposite, their distance and width."""
        one, other = (self.foot[[k, (k + 1) % len(self.foot)]] for k in (side, side + len(self.foot) // 2))
        axis = one.mean(axis=0) - other.mean(axis=0)
        length = float(np.linalg.norm(axis))
        return (one + other).mean(axis=0) / 2.0, axis / length, length, float(np.linalg.norm(one[1] - one[0]))


def polygon(sides: int, across_m: tuple[float, float], turn: float, at: tuple[float, float]) -> np.ndarray:
    """A rectangle, or a regular polygon, so far from side to side."""
    if sides == 4:
        corners = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]]) * across_m / 2.0
    else:
        angle = 2.0 * np.pi * (np.arange(sides) - 0.5) / sides
        corners = across_m[0] / 2.0 / np.cos(np.pi / sides) * np.column_stack([np.cos(angle), np.sin(angle)])
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + at)


def known_wall(seed: int) -> list[Prism]:
    """One of each kind, at random sizes that keep off every limit, at random places and turned at random."""
    random = np.random.default_rng(seed)
    u = random.uniform
    kinds = [  # sides, from side to side, height, lean of the sides in degrees, which pairs can be gripped
        (4, (u(0.045, 0.09), u(0.045, 0.09)), u(0.045, 0.06), 0.0, (True, True)),
        (4, (u(0.045, 0.09), u(0.045, 0.09)), u(0.045, 0.06), u(4.0, 9.0), (True, True)),
        (4, (u(0.045, 0.09), u(0.03, 0.04)), u(0.045, 0.06), 0.0, (True, True)),
        (6, (u(0.06, 0.09),) * 2, u(0.045, 0.06), 0.0, (True, True, True)),
        (6, (u(0.022, 0.025),) * 2, u(0.045, 0.06), 0.0, (False, False, False)),
        (4, (u(0.05, 0.07), u(0.008, 0.012)), u(0.045, 0.06), 0.0, (False, False)),
        (4, (u(0.125, 0.14), u(0.125, 0.14)), u(0.045, 0.06), 0.0, (False, False)),
        (4, (u(0.09, 0.1), u(0.09, 0.1)), u(0.03, 0.035), u(25.0, 35.0), (False, False)),
        (4, (u(0.05, 0.07), u(0.05, 0.07)), u(0.014, 0.018), 0.0, (False, False)),
    ]
    found = []
    for (sides, across, height, lean, can), (x, y) in zip(kinds, random.permutation(PLACES_M), strict=True):
        turn, at = u(-np.pi, np.pi), (x + u(-0.01, 0.01), y + u(-0.01, 0.01))
        shrink = 2.0 * height * np.tan(np.radians(lean))
        top = polygon(sides, (across[0] - shrink, across[1] - shrink), turn, at)
        found.append(Prism(polygon(sides, across, turn, at), top, height, dict(enumerate(can))))
    return found


def inside(points: np.ndarray, solid: trimesh.Trimesh) -> np.ndarray:
    normals, offsets = half_spaces(solid)
    return np.asarray((points @ normals.T < offsets - 1e-9).all(axis=1))


def seen(prisms: list[Prism], noise_m: float, form: str, folder: Path) -> Placed:
    """The wall as the importer reads it from a file."""
    slab = trimesh.creation.box((*SLAB_M, 0.1), trimesh.transformations.translation_matrix([0, 0, -0.05]))
    solids = [slab, *(prism.mesh for prism in prisms)]
    path, random = folder / "scan.ply", np.random.default_rng(0)
    if form == "mesh":
        trimesh.util.concatenate(solids).export(path)
    else:
        parts = []
        for i, solid in enumerate(solids):
            points = trimesh.sample.sample_surface(solid, int(solid.area / SPACING_M**2), seed=i)[0]
            hidden = np.any([inside(points, other) for other in solids if other is not solid], axis=0)
            parts.append(points[~hidden & (points[:, 2] > -0.001)])
        points = np.concatenate(parts)
        trimesh.PointCloud(points + random.normal(0.0, noise_m, points.shape)).export(path)
    return placed(read_surface(path, 1.0, None, UPRIGHT), UPRIGHT, None, 90.0)


def places_of(wall: Placed, robot: Robot) -> Places:
    return find_places(
        wall.surface, bodies(wall.surface, planes(wall.surface.samples)), robot, Limits(coverage=COVERAGE)
    )[0]


def matched(prisms: list[Prism], wall: Placed, places: Places) -> list[tuple[int, int] | None]:
    """By place the prism and its pair of sides between which it is."""
    found = []
    back = (places.middle - wall.offset) @ wall.rotation
    axes = np.column_stack([np.cos(places.yaw_rad), np.sin(places.yaw_rad), 0.0 * places.yaw_rad]) @ wall.rotation
    for middle, axis in zip(back, axes, strict=True):
        which = None
        for (i, prism), side in itertools.product(enumerate(prisms), range(3)):
            if side in prism.graspable:
                centre, way, length, width = prism.pair(side)
                off = middle[:2] - centre
                near = abs(off @ way) < length / 2.0 and abs(off @ [-way[1], way[0]]) < width / 2.0
                which = (i, side) if near and abs(axis[:2] @ way) > np.cos(np.radians(16.0)) else which
        found.append(which)
    return found


@pytest.mark.parametrize(
    ("form", "noise_m", "seed", "least"),
    [
        ("cloud", 0.001, 1, 0.9),
        pytest.param("cloud", 0.0, 2, 0.98, marks=pytest.mark.sweep),
        pytest.param("cloud", 0.001, 3, 0.9, marks=pytest.mark.sweep),
        pytest.param("mesh", 0.0, 4, 0.98, marks=pytest.mark.sweep),
    ],
)
def test_the_grips_that_are_there_are_found(form: str, noise_m: float, seed: int, least: float, tmp_path: Path) -> None:
    prisms = known_wall(seed)
    wall = seen(prisms, noise_m, form, tmp_path)
    hits = matched(prisms, wall, places_of(wall, ROBOT))
    right = [hit is not None and prisms[hit[0]].graspable[hit[1]] for hit in hits]
    assert np.mean(right) >= least, [hit for hit, good in zip(hits, right, strict=True) if not good]
    wanted = {(i, side) for i, prism in enumerate(prisms) for side, can in prism.graspable.items() if can}
    assert len(wanted & set(hits)) >= least * len(wanted), wanted - set(hits)


def common_depth_m(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
    """Radius of the largest ball in both solids, each given by half-spaces normals @ x <= offsets; 0 where none is."""
    normals, offsets = np.vstack([one[0], other[0]]), np.concatenate([one[1], other[1]])
    best = linprog(
        [0, 0, 0, -1.0],
        np.column_stack([normals, np.ones(len(normals))]),
        offsets,
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    return float(best.x[3]) if best.status == 0 else 0.0


def half_spaces(solid: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    return solid.face_normals, np.einsum("fi,fi->f", solid.triangles_center, solid.face_normals)


@pytest.mark.parametrize("seed", [5, pytest.param(6, marks=pytest.mark.sweep)])
def test_neither_fingers_nor_palm_cut_the_wall(seed: int, tmp_path: Path) -> None:
    """By exact half-spaces, with open fingers; the wall is the union of its convex solids."""
    prisms = known_wall(seed)[::2]
    wall = seen(prisms, 0.0, "mesh", tmp_path)
    places, gripper = places_of(wall, ROBOT), ROBOT.gripper
    assert len(places) > 100
    radius, palm = gripper.pad_radius_m, gripper.opening_m[1]
    solids = [prism.mesh.apply_transform(moved(wall)) for prism in prisms]
    for i in range(0, len(places), len(places) // 40):
        half, top = float(places.width_m[i]) / 2.0, gripper.finger_height_m
        open_m = min(half + radius, palm)
        boxes = [
            ((open_m, -radius, -radius), (open_m + 2.0 * radius, radius, top)),
            ((-open_m - 2.0 * radius, -radius, -radius), (-open_m, radius, top)),
            ((-palm, -radius, top), (palm, radius, top + 0.04)),
        ]
        turn = trimesh.transformations.rotation_matrix(places.yaw_rad[i], UPRIGHT)
        turn[:3, 3] = places.middle[i]
        for bounds, solid in itertools.product(boxes, solids):
            part = trimesh.creation.box(bounds=bounds).apply_transform(turn)
            assert common_depth_m(half_spaces(part), half_spaces(solid)) < 1e-3


def moved(wall: Placed) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = wall.rotation, wall.offset
    return transform
