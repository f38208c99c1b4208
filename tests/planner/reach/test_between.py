"""Links of two limbs against each other: the distance that Coal finds, and the masks made of it."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.reach.arm import CLEAR_M, reaches_of
from crux_planner.reach.between import apart, gap_m, segment_to_segment
from crux_planner.reach.body_grid import BodyGrid, stance
from hypothesis import given, settings
from hypothesis import strategies as st

from .pinocchio_limb import PinocchioLimb, drawn

PALMS_MORE_M = 0.035  # of the capsules around two palms than of the palms, at most


@pytest.mark.parametrize("pair", [(0, 2), (1, 3)])
def test_the_gap_between_two_limbs_is_that_of_coal(robot: Robot, pair: tuple[int, int]) -> None:
    """Less what the capsule around a palm is larger."""
    random = np.random.default_rng(sum(pair))
    one, two = (PinocchioLimb(robot, limb) for limb in pair)
    (q, poses), (other_q, other_poses) = (drawn(each, random, 500, 0.05, 0.2) for each in (one, two))
    mine, theirs = (reaches_of(robot)[limb] for limb in pair)
    same = np.abs(mine.angles(poses) - q).max(axis=1) + np.abs(theirs.angles(other_poses) - other_q).max(axis=1) < 1e-6
    q, other_q = q[same], other_q[same]  # the others are within limits with other angles, too
    links, others = (r.links(p.where(np.flatnonzero(same))) for r, p in ((mine, poses), (theirs, other_poses)))
    expected = np.array([one.apart_m(a, two, b) for a, b in zip(q, other_q, strict=True)])
    found = gap_m(links, others)
    outside = expected > 0.0
    assert (expected < 0.1).sum() > 5
    assert (found <= expected + 1e-6)[outside].all()
    assert (found >= expected - PALMS_MORE_M)[outside].all()
    assert (np.abs(found - expected) < 1e-6).mean() > 0.3
    for hands in (True, False):
        clear = gap_m(links, others, hands=hands) >= CLEAR_M
        np.testing.assert_array_equal(apart(links, others, CLEAR_M, hands), clear)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_segments_are_as_far_apart_as_their_nearest_samples(seed: int) -> None:
    """Points, parallel ones and those that cross too."""
    random = np.random.default_rng(seed)
    a0, a1, b0, b1 = random.uniform(-1.0, 1.0, (4, 3)).round(seed % 3)
    along = np.linspace(0.0, 1.0, 201)[:, None]
    samples = np.linalg.norm((a0 + along * (a1 - a0))[:, None] - (b0 + along * (b1 - b0)), axis=2).min()
    step = (np.linalg.norm(a1 - a0) + np.linalg.norm(b1 - b0)) / 400
    found = float(segment_to_segment(a0, a1, b0, b1))
    assert samples - step - 1e-9 <= found <= samples + 1e-9
    assert float(segment_to_segment(b1, b0, a0, a1)) == pytest.approx(found, abs=1e-9)


def test_limbs_whose_links_meet_are_cut_out_of_a_stance(robot: Robot) -> None:
    """Two limbs of one side on grippers near each other, cell by cell."""
    steps = np.arange(-0.3, 0.31, 0.05)
    grid = BodyGrid(np.zeros(1), np.zeros(1), np.zeros(1), np.array([0.185]), steps, steps - 0.3)
    reaches = reaches_of(robot)
    grippers = {0: np.array([0.06, 0.0, 0.035, 0.0]), 2: np.array([-0.06, 0.0, 0.035, 0.0])}
    both = stance([grid.held(reaches[limb], at) for limb, at in grippers.items()])
    kept = grid.apart(both, grippers, reaches, CLEAR_M)
    assert not (kept & ~both).any()
    one, two = PinocchioLimb(robot, 0), PinocchioLimb(robot, 2)
    seen = [reaches[limb].angles(grid.seen(at)) for limb, at in grippers.items()]
    cells = np.argwhere(both)
    assert len(cells) > 5
    for cell in map(tuple, cells):
        gap = one.apart_m(seen[0][cell], two, seen[1][cell])
        assert not kept[cell] or gap >= CLEAR_M - 1e-6
        assert kept[cell] or gap <= CLEAR_M + PALMS_MORE_M
