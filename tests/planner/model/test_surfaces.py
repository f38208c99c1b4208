"""Bounded surfaces in the planner: how far grippers are off them, and how high what lies under a swing is."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.scenario import Slab, Wall
from crux_planner.model.contacts import GripperShape
from crux_planner.model.cuboids import cuboids_of
from crux_planner.model.surfaces import Surfaces
from scipy.spatial.transform import Rotation

SHAPE = GripperShape(0.008, 0.066, 0.048, 0.012, 0.05)
RIGHT_WALL = Slab("side", (0.0, 1.1), (4.0, 4.0, 0.1), tilt_deg=(90.0, 0.0))  # its surface is y = 1


def slabs(tilts_deg: list[tuple[float, float]]) -> list[Slab]:
    return [Slab(f"{i}", (0.1 * i, -0.2), (0.5, 0.3, 0.06), 20.0 * i, tilt_deg=t) for i, t in enumerate(tilts_deg)]


@pytest.mark.parametrize(("off_m", "yaw_rad"), [(0.2, 0.0), (0.2, np.pi / 2), (0.05, np.pi / 2)])
def test_a_gripper_beside_a_side_wall(off_m: float, yaw_rad: float) -> None:
    """Its palm is 0.066 m long and as thick as a pad."""
    surfaces = Surfaces.of(Wall(90.0, slabs=(RIGHT_WALL,), endless=False), 0.0)
    centre = np.array([0.0, 1.0 - off_m, 0.03])
    gap, name = surfaces.nearest(centre, gripper_rotation(yaw_rad, np.zeros(2)), 0.04, SHAPE)
    along = 0.012 if yaw_rad == 0.0 else max(0.066, 0.04 + 2 * 0.012)
    assert gap == pytest.approx(off_m - along, abs=1e-9)
    assert name == "side"


def test_an_endless_wall_is_the_nearest_to_a_gripper_aslant() -> None:
    turn = gripper_rotation(0.0, np.array([0.0, np.radians(30)]))
    gap, name = Surfaces.of(Wall(90.0), 0.0).nearest(np.array([0.0, 0.0, 0.05]), turn, 0.04, SHAPE)
    assert gap == pytest.approx(0.05 - np.sin(np.radians(30)) * 0.052 - 0.012)
    assert name == "the wall"


def test_what_is_highest_near_points_is_never_underestimated() -> None:
    """Against the highest of dense samples of boxes turned any way; close where tops face up."""
    random, reach_m = np.random.default_rng(4), 0.03
    made = slabs([(0.0, 20.0), (-25.0, 5.0), (10.0, -80.0), (120.0, 0.0)])
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 41)] * 3), axis=-1).reshape(-1, 3)
    for slab in made:
        turn = Rotation.from_euler("ZYX", [slab.yaw_deg, *slab.tilt_deg[::-1]], degrees=True)
        solid = turn.apply(grid * slab.size_m + [0.0, 0.0, slab.size_m[2] / 2])
        solid[:, :2] += slab.position_m
        for _ in range(20):
            point = np.array([*slab.position_m, 0.0]) + random.uniform(-0.3, 0.3, 3)
            near = np.hypot(*(solid - point)[:, :2].T) < reach_m
            highest = solid[near, 2].max(initial=-np.inf)
            found = cuboids_of([slab], 0.0).top_near(point, reach_m)
            assert found >= highest - 1e-9
            if max(map(abs, slab.tilt_deg)) < 45 and near.sum() > 200:
                assert found - highest < 0.03


def test_nothing_is_high_where_nothing_is() -> None:
    assert cuboids_of(slabs([(0.0, 20.0)]), 0.0).top_near(np.array([2.0, 2.0, 0.0]), 0.03) == -np.inf
