"""Ways of a gripper: corners, timing, clearance all along, and ways around what is too tall."""

from __future__ import annotations

import numpy as np
import pytest
from crux_planner.model.contacts import Contact, GripperShape, SwingLimits
from crux_planner.model.cuboids import Cuboids
from crux_planner.swing.swing import Swing, footprint, gripper_gap, palm_gap, plan_swing
from scipy.spatial import cKDTree

SHAPE = GripperShape(0.008, 0.066, 0.048, 0.012, 0.05)
LIMITS = SwingLimits(2.0, 0.05, 0.25, 0.024, 0.01, 0.16)


def contact(hold: int, x: float, y: float, yaw: float = 0.0) -> Contact:
    return Contact(hold, 0, 0, yaw, np.array([x, y, 0.035]), 0.06, np.full(2, 2.2), np.zeros((2, 3)), 0.048)


def wall(*extra: tuple[float, float, float]) -> Cuboids:
    """Holds at (0, 0) and (0.2, 0), and cuboids of given heights."""
    places = [(0.0, 0.0), (0.2, 0.0), *[(x, y) for x, y, _ in extra]]
    halves = [(0.03, 0.03, 0.03)] * 2 + [(0.03, 0.03, height / 2) for _, _, height in extra]
    return Cuboids(np.array(places), np.array(halves), np.zeros(len(places)))


def swing(cuboids: Cuboids, end_yaw: float = 0.0) -> Swing | None:
    return plan_swing(contact(0, 0.0, 0.0), contact(1, 0.2, 0.0, end_yaw), cuboids, SHAPE, LIMITS)


def test_a_swing_rises_straight_crosses_above_and_comes_straight_down() -> None:
    found = swing(wall())
    assert found is not None
    assert found.intervals == 5  # up, three steps of at most 0.095 m, down
    poses = found.poses(found.intervals)
    np.testing.assert_allclose(poses[0], [0, 0, 0.035, 0, 0.03])
    np.testing.assert_allclose(poses[1, :2], [0, 0])
    np.testing.assert_allclose(poses[-2, :2], [0.2, 0])
    np.testing.assert_allclose(poses[-1], [0.2, 0, 0.035, 0, 0.03])
    assert (poses[1:-1, 2] >= 0.06 + LIMITS.clearance_m).all()
    assert (poses[1:-1, 4] == 0.048).all()


@pytest.mark.parametrize("extra", range(6))
def test_spare_intervals_slow_the_swing_and_change_no_place_on_it(extra: int) -> None:
    found = swing(wall(), end_yaw=1.2)
    assert found is not None
    poses = found.poses(found.intervals + extra)
    assert len(poses) == found.intervals + extra + 1
    steps = np.abs(np.diff(poses, axis=0))
    assert np.linalg.norm(steps[:, :3], axis=1).max() <= LIMITS.speed_m_s * LIMITS.dt_s
    assert steps[:, 3].max() <= LIMITS.yaw_rate_rad_s * LIMITS.dt_s
    np.testing.assert_array_equal(poses[[0, -1]], found.poses(found.intervals)[[0, -1]])


def test_a_low_cuboid_is_stepped_over_with_clearance() -> None:
    cuboids = wall((0.1, 0.0, 0.1))
    found = swing(cuboids)
    assert found is not None
    assert found.stations[:, 2].min() >= 0.1 + LIMITS.clearance_m
    assert len(found.stations) == 2


def test_a_tall_cuboid_is_gone_around_with_clearance_for_fingers_and_palm() -> None:
    pillar = Cuboids(
        np.array([[0.0, 0.0], [0.32, 0.0], [0.16, 0.0]]),
        np.array([[0.03, 0.03, h] for h in (0.03, 0.03, 0.15)]),
        np.zeros(3),
    )
    found = plan_swing(contact(0, 0.0, 0.0), contact(1, 0.32, 0.0), pillar, SHAPE, LIMITS)
    assert found is not None
    assert len(found.stations) > 2
    way = found.poses(100)[3:-3]
    columns = footprint(way, SHAPE.half_length(way[:, 4]))
    assert pillar.plan_distance(columns)[..., 2].min() >= SHAPE.pad_radius + LIMITS.body_clearance_m - 1e-9


def test_a_wall_of_tall_cuboids_leaves_no_way() -> None:
    fence = [(0.1, y, 0.3) for y in np.arange(-0.6, 0.61, 0.06)]
    assert swing(wall(*fence)) is None


def test_a_cuboid_beside_the_way_but_not_on_it_does_not_lift_the_swing() -> None:
    found, alone = swing(wall((0.1, 0.12, 0.1))), swing(wall())
    assert found is not None
    assert alone is not None
    assert found.stations[0, 2] == alone.stations[0, 2]


def test_grippers_side_by_side_are_measured_between_their_centre_lines() -> None:
    a = footprint(np.array([0.0, 0.0, 0.0, 0.0]), 0.05)
    b = footprint(np.array([0.0, 0.1, 0.0, np.pi / 2]), 0.05)
    assert gripper_gap(a, b) == pytest.approx(0.05)


def test_palms_meet_at_their_corners_first() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        yaw = rng.uniform(-0.3, 0.3, 2)
        a, b = np.array([[0.0, 0.0, yaw[0], 0.07]]), np.array([[0.17, rng.uniform(-0.02, 0.02), yaw[1], 0.07]])
        edges = []
        for x, y, turn, length in (a[0], b[0]):
            along, across = np.meshgrid(np.linspace(-length, length, 141), np.linspace(-0.02, 0.02, 41))
            c, s = np.cos(turn), np.sin(turn)
            edges.append(np.stack([x + c * along - s * across, y + s * along + c * across], -1).reshape(-1, 2))
        sampled = cKDTree(edges[1]).query(edges[0])[0].min()
        assert palm_gap(a, b, 0.02) == pytest.approx(sampled, abs=1.5e-3)
