"""Trunk, links and boxes that they keep off: the search's masks against MuJoCo's distances, or samples of a link."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from crux_planner.model.cuboids import Cuboids
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.reach.solids import Box, Links
from crux_planner.reach.trunk_clearance import links_off_slabs, off_slabs
from scipy.spatial.transform import Rotation

HALF_M, SLAB_HALF_M = np.array([0.15, 0.11, 0.03]), np.array([0.2, 0.3, 0.025])
CLEAR_M, SPARE_M = 0.006, 0.004
ONE = np.zeros(1)


def distance_m(place: np.ndarray, rpy: list[float], foot: np.ndarray, turn: Rotation) -> float:
    """Of the trunk there and the slab."""
    spec = mujoco.MjSpec()
    middle = foot + turn.apply([0.0, 0.0, SLAB_HALF_M[2]])
    for half_m, at, turned in ((HALF_M, place, Rotation.from_euler("xyz", rpy)), (SLAB_HALF_M, middle, turn)):
        quat = np.roll(turned.as_quat(), 1)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half_m, pos=at, quat=quat)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None))


@pytest.mark.parametrize("angles_rad", [(0.4, 0.0, 0.0), (0.3, -0.5, 0.2)])
def test_the_trunk_is_where_it_keeps_off_a_slab(angles_rad: tuple[float, float, float]) -> None:
    yaw, pitch, roll = angles_rad
    turn, foot = Rotation.from_euler("ZYX", angles_rad), np.array([0.1, 0.05, 0.0])
    slab = Cuboids(foot[None, :2], SLAB_HALF_M[None], np.array([yaw]), np.array([[roll, pitch]]), foot[2:])
    yaws, heights, along = np.array([-0.2, 0.3]), np.linspace(0.0, 0.3, 7), np.linspace(-0.4, 0.4, 5)
    grid = BodyGrid(yaws, ONE, ONE + 0.1, heights, along, np.array([-0.2, 0.1]))
    trunk = Box(np.zeros(3), np.eye(3), HALF_M)
    clear = off_slabs(grid, (trunk,), slab, CLEAR_M)
    gaps_m = np.empty(grid.shape)
    for cell in np.ndindex(*grid.shape):
        place, rpy = grid.pose(cell)
        gaps_m[cell] = distance_m(place, rpy.tolist(), foot, turn)
    assert 0.1 < clear.mean() < 0.9
    assert gaps_m[clear].min() >= CLEAR_M - 1e-4
    assert (gaps_m[~clear] >= CLEAR_M + SPARE_M).mean() < 0.05  # corner against corner


def test_links_are_where_they_keep_off_a_slab() -> None:
    random, count, radius_m = np.random.default_rng(3), 200, np.array([0.02, 0.03, 0.02])
    turn, foot = Rotation.from_euler("ZYX", (0.3, -0.5, 0.2)), np.array([0.1, 0.05, 0.0])
    slab = Cuboids(foot[None, :2], SLAB_HALF_M[None], np.array([0.3]), np.array([[0.2, -0.5]]), foot[2:])
    start, end = (random.uniform(-0.2, 0.2, (count, 3, 3)) for _ in range(2))
    poses = np.hstack([random.uniform(-0.4, 0.4, (count, 3)), random.uniform(-0.5, 0.5, (count, 3))])
    links = Links(
        start, end, radius_m, np.array([False, False, True])
    )  # the last is the gripper's, and may be anywhere
    share, gaps_m = np.linspace(0.0, 1.0, 2001)[:, None], np.full(count, np.inf)
    middle = foot + turn.apply([0.0, 0.0, SLAB_HALF_M[2]])
    for i, (place, rpy) in enumerate(zip(poses[:, :3], poses[:, 3:], strict=True)):
        for k in range(2):
            along = start[i, k] + share * (end[i, k] - start[i, k])
            seen = turn.inv().apply(place + Rotation.from_euler("xyz", rpy).apply(along) - middle)
            off = np.linalg.norm(np.maximum(np.abs(seen) - SLAB_HALF_M, 0.0), axis=1).min()
            gaps_m[i] = min(gaps_m[i], off - radius_m[k])
    clear = links_off_slabs(poses, links, slab, CLEAR_M)
    sure = np.abs(gaps_m - CLEAR_M) > 1e-3  # two samples are up to 0.4 mm apart
    assert 0.2 < clear.mean() < 0.9
    assert (clear == (gaps_m >= CLEAR_M))[sure].all()
