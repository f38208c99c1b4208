"""The consensus variables, their residuals, and the motion block as a projection."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.mass import centres_of_mass
from crux_planner.trajectory.consensus import Eta, Residuals, Scales, finger_positions
from scenes import Scene, scene


def random_eta(steps: int, seed: int) -> Eta:
    rng = np.random.default_rng(seed)
    zero = Eta.zeros(steps)
    return Eta(*(rng.normal(size=getattr(zero, f.name).shape) for f in fields(zero)))


def test_residuals_are_largest_and_rms_of_each_kind() -> None:
    difference = random_eta(7, 1)
    got = Residuals.of(difference)
    positions = [*difference.body[:, :3].flat, *difference.fingers.flat]
    turns = [*difference.body[:, 3:6].flat, *difference.yaws.flat]
    for largest, rms, values in (
        (got.position_m, got.position_rms_m, positions),
        (got.orientation_rad, got.orientation_rms_rad, turns),
        (got.force_N, got.force_rms_N, list(difference.forces.flat)),
        (got.moment_Nm, got.moment_rms_Nm, list(difference.moments.flat)),
    ):
        assert largest == pytest.approx(max(abs(v) for v in values))
        assert rms == pytest.approx((sum(v * v for v in values) / len(values)) ** 0.5)


@pytest.mark.parametrize(
    ("position", "force", "converged"), [(0.03, 0.5, True), (0.031, 0.1, False), (0.01, 0.51, False)]
)
def test_thresholds_are_the_papers_in_the_maximum_norm(position: float, force: float, converged: bool) -> None:
    difference = Eta.zeros(3)
    difference.fingers[2, 5, 1], difference.forces[0, 3, 2] = -position, force
    assert Residuals.of(difference).converged is converged


def test_fingers_stand_apart_along_the_opening_axis() -> None:
    poses = np.array([[[1.0, 2.0, 3.0, np.pi / 2, 0.04]]])
    np.testing.assert_allclose(finger_positions(poses)[0], [[1.0, 2.04, 3.0], [1.0, 1.96, 3.0]], atol=1e-12)


@pytest.fixture(scope="module")
def small() -> Scene:
    return scene(10, goal_m=0.03)


@pytest.fixture(scope="module")
def projected(small: Scene) -> tuple[MotionBlock, Eta, Eta]:
    """A motion block, a target that it cannot meet, and its answer."""
    problem = small.problem
    body = np.tile([*problem.start.position_m, *[0.0] * 9], (11, 1))
    target = Eta.of_contacts(problem, small.windows.schedule([]), body, [{} for _ in range(10)])
    target.forces[:] = np.random.default_rng(3).normal(scale=4.0, size=target.forces.shape)
    block = MotionBlock(problem, scales=Scales())
    return block, target, block.project(target, 10.0)


def test_the_motion_block_keeps_the_dynamics(small: Scene, projected: tuple[MotionBlock, Eta, Eta]) -> None:
    problem, delta = small.problem, projected[2]
    for k in range(problem.steps):
        now, then, dt = delta.body[k], delta.body[k + 1], problem.dt_s
        force = delta.forces[k].sum(axis=0)
        middles = (delta.fingers[k, 0::2] + delta.fingers[k, 1::2]) / 2
        hands = np.column_stack([middles, delta.yaws[k]])
        arms = delta.fingers[k] - centres_of_mass(problem, now[None, :6], hands[None])[0]
        moment = np.cross(arms, delta.forces[k]).sum(axis=0) + delta.moments[k].sum(axis=0)
        np.testing.assert_allclose(then[:3], now[:3] + dt * now[6:9], atol=1e-5)
        np.testing.assert_allclose(then[6:9], now[6:9] + dt * (force / problem.mass_kg + problem.gravity_h), atol=1e-5)
        omega, inertia = now[9:12], problem.inertia_b
        turned = rotation_from_rpy(now[3:6]).T @ moment - np.cross(omega, inertia @ omega)
        np.testing.assert_allclose(then[9:12], omega + dt * np.linalg.solve(inertia, turned), atol=1e-4)


def test_the_motion_block_keeps_the_reach(small: Scene, projected: tuple[MotionBlock, Eta, Eta]) -> None:
    problem, delta = small.problem, projected[2]
    for k in range(1, problem.steps + 1):
        centres = delta.fingers[k].reshape(4, 2, 3).mean(axis=1)
        offsets = (centres - delta.body[k, :3]) @ rotation_from_rpy(delta.body[k, 3:6])
        assert (np.abs(offsets - problem.boxes.centre_b_m) <= problem.boxes.half_m + 1e-5).all()


def test_projecting_twice_changes_nothing(projected: tuple[MotionBlock, Eta, Eta]) -> None:
    block, target, once = projected
    twice = block.project(once, 10.0)
    assert Residuals.of(once - target).force_N > 1.0
    residuals = Residuals.of(twice - once)
    assert residuals.position_m < 1e-3
    assert residuals.force_N < 0.02
