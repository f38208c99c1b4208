"""Inner and outer sets of what limbs reach hold what they promise, and are about as large as the limb allows."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.errors import InfeasibleError
from crux_planner.model import build, kept, workspace
from crux_planner.model.build import reach_of
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z
from crux_planner.model.workspace import (
    LEVEL_RAD,
    LimbReach,
    WorkspaceRange,
    acceptance_boxes,
    largest_rectangle,
)
from hypothesis import given
from hypothesis import strategies as st
from limb_forward import forward
from other_limbs import other_limbs
from scipy.spatial import HalfspaceIntersection


@pytest.fixture(scope="module")
def wanted(robot: Robot) -> WorkspaceRange:
    grasp = robot.grasp
    return WorkspaceRange(
        robot.body.height_m,
        grasp.pad_height_m,
        0.086,
        grasp.max_swing_height_m,
        LEVEL_RAD,
        grasp.gripper_yaw_rad,
        robot.body.max_tilt_rad,
    )


def test_boxes_stand_where_the_physics_study_found_the_workspace(robot: Robot, wanted: WorkspaceRange) -> None:
    boxes = acceptance_boxes(robot.limbs, wanted)
    np.testing.assert_allclose(np.abs(boxes.centre_b_m[:, :2]), np.tile([0.14, 0.36], (4, 1)), atol=0.02)
    np.testing.assert_allclose(boxes.centre_b_m[:, 2], -0.13, atol=0.01)
    assert (boxes.half_m >= [0.13, 0.07, 0.05]).all()
    assert [tuple(np.sign(c[:2])) for c in boxes.centre_b_m] == [(1, 1), (1, -1), (-1, 1), (-1, -1)]


def test_every_pose_in_a_box_has_inverse_kinematics(robot: Robot, wanted: WorkspaceRange) -> None:
    boxes, random = acceptance_boxes(robot.limbs, wanted), np.random.default_rng(0)
    for limb, centre in zip(robot.limbs, boxes.centre_b_m, strict=True):
        n = 4000
        positions = centre + random.uniform(-1, 1, (n, 3)) * boxes.half_m
        tilts = np.column_stack([random.uniform(-1, 1, (n, 2)) * wanted.max_tilt_rad, np.zeros(n)])
        yaw = rotation_z(random.uniform(*wanted.gripper_yaw_rad, n))
        q, reached = inverse(limb, positions, np.swapaxes(rotation_from_rpy(tilts), -1, -2) @ yaw)
        assert reached.all()
        assert limit_margin(limb, q).min() > 0.0


def test_limbs_that_lack_some_yaws_have_boxes_for_the_others(tmp_path: Path, wanted: WorkspaceRange) -> None:
    robot, random = load_robot(other_limbs("hands that turn one way", tmp_path)), np.random.default_rng(0)
    model, boxes = load_model(robot), acceptance_boxes(robot.limbs, wanted)
    assert (boxes.half_m >= [0.1, 0.05, 0.05]).all()
    for limb, part, centre in zip(robot.limbs, model.limbs, boxes.centre_b_m, strict=True):
        side, n = np.sign(limb.shoulder_b_m[1]), 300
        assert (np.sign(centre[:2]) == np.sign(limb.shoulder_b_m[:2])).all()
        places = centre + random.uniform(-1, 1, (n, 3)) * boxes.half_m
        turns = rotation_z(-side * random.uniform(0.6, 1.4, n))
        (found,) = solve([part], [places], [turns])
        assert found.position_error_m.max() < 1e-5
        assert ((found.q_rad >= limb.lower_rad) & (found.q_rad <= limb.upper_rad)).all()
        assert found.rotation_error_rad.max() < 1e-4


def test_a_range_no_limb_can_serve_is_an_error(robot: Robot, wanted: WorkspaceRange) -> None:
    high = WorkspaceRange((0.6, 0.7), *list(vars(wanted).values())[1:])
    with pytest.raises(InfeasibleError, match="no acceptance box"):
        acceptance_boxes(robot.limbs, high)


@given(st.integers(2, 7), st.integers(2, 7), st.integers(0, 2**32 - 1))
def test_largest_rectangle_is_what_trying_all_finds(rows: int, columns: int, seed: int) -> None:
    mask = np.random.default_rng(seed).random((rows, columns)) < 0.8
    area, (i0, i1, j0, j1) = largest_rectangle(mask)
    best = max(
        (
            (b - a) * (d - c)
            for a in range(rows)
            for b in range(a + 1, rows)
            for c in range(columns)
            for d in range(c + 1, columns)
            if mask[a : b + 1, c : d + 1].all()
        ),
        default=0,
    )
    assert area == best
    if best:
        assert mask[i0 : i1 + 1, j0 : j1 + 1].all()
        assert (i1 - i0) * (j1 - j0) == best


@pytest.fixture(scope="module", params=[LEVEL_RAD, 0.2])
def reach(request: pytest.FixtureRequest, robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> LimbReach:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        return reach_of(robot, request.param)


def test_the_checkers_kinematics_reaches_every_place_of_the_inner_set(robot: Robot, reach: LimbReach) -> None:
    """Places at its very edges too, at any tilt it is for and any yaw, by the check's numeric inverse kinematics."""
    random, n, tilt = np.random.default_rng(1), 1500, reach.inner.max_tilt_rad
    for i, limb in enumerate(load_model(robot).limbs):
        corners = reach.inner.centre_b_m[i] + 1.3 * random.uniform(-1, 1, (4 * n, 3)) * reach.inner.half_m
        share = np.linspace(0.0, 1.0, 40)[:, None, None]
        ways = reach.inner.centre_b_m[i] + share * (corners - reach.inner.centre_b_m[i])
        inside = (reach.inner.beyond(i, ways) <= 0.0).all(axis=2)
        places = ways[np.cumsum(inside, axis=0).argmax(axis=0), np.arange(4 * n)][:n]
        rpy = np.column_stack([random.choice([-tilt, tilt, 0.0], (n, 2)), np.zeros(n)])
        yaws = rotation_z(random.uniform(*robot.grasp.gripper_yaw_rad, n))
        turn = np.swapaxes(rotation_from_rpy(rpy), -1, -2) @ yaws
        (found,) = solve([limb], [places], [turn])
        assert found.position_error_m.max() < 1e-5
        assert (found.q_rad >= limb.lower_rad).all()
        assert (found.q_rad <= limb.upper_rad).all()


def test_the_checkers_kinematics_reaches_the_corners_of_the_inner_set(robot: Robot, reach: LimbReach) -> None:
    inner, tilt = reach.inner, reach.inner.max_tilt_rad
    low, high = robot.grasp.gripper_yaw_rad
    for i, limb in enumerate(load_model(robot).limbs):
        most, least = inner.middle_m[i] + inner.extent_m[i], inner.middle_m[i] - inner.extent_m[i]
        sides = np.vstack([np.column_stack([inner.directions, -most]), np.column_stack([-inner.directions, least])])
        corners = HalfspaceIntersection(sides, inner.centre_b_m[i]).intersections
        for roll, pitch, yaw in itertools.product((-tilt, tilt), (-tilt, tilt), (low, 0.0, high)):
            turn = rotation_from_rpy(np.array([roll, pitch, 0.0])).T @ rotation_z(yaw)
            (found,) = solve([limb], [corners], [np.broadcast_to(turn, (len(corners), 3, 3))])
            assert found.position_error_m.max() < 1e-5
            assert (found.q_rad >= limb.lower_rad).all()
            assert (found.q_rad <= limb.upper_rad).all()


def test_no_posture_grips_outside_the_outer_set(robot: Robot, reach: LimbReach) -> None:
    """Postures anywhere within the joint limits whose gripper stands upright on a wall that the body may be off."""
    random, n, tilt = np.random.default_rng(2), 100_000, robot.body.max_tilt_rad
    for i, limb in enumerate(robot.limbs):
        q = random.uniform(limb.lower_rad, limb.upper_rad, (n, 6))
        q[: n // 2, 2] = limb.lower_rad[2]  # stretched as far as they go
        q[: n // 2 : 3, 0] = random.choice([limb.lower_rad[0], limb.upper_rad[0]], len(q[: n // 2 : 3]))
        rpy = random.uniform(-tilt, tilt, (n, 3)) * [1.0, 1.0, 0.0]
        rpy[::2, :2] = random.choice([-tilt, tilt], rpy[::2, :2].shape)
        upright = np.swapaxes(rotation_from_rpy(rpy), -1, -2)[..., 2]
        place, turn = forward(limb, q)
        wrist = place + limb.wrist_to_gripper_m * turn[..., 2]
        place = wrist - limb.wrist_to_gripper_m * upright  # the wrist turns it upright, whatever its own limits
        height = np.einsum("nj,nj->n", place, upright)
        (low, high), (least, most) = robot.body.height_m, robot.grasp.pad_height_m
        grips = (height >= least - high) & (height <= most - low)
        assert grips.sum() > 1000
        assert reach.outer.beyond(i, wrist[grips]).max() <= 1e-9
        assert reach.outer.beyond(i, wrist[grips]).max() >= -0.03  # and it is no larger than need be


def test_inner_sets_hold_the_boxes_and_are_mirror_images(reach: LimbReach) -> None:
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    for i, centre in enumerate(reach.box.centre_b_m):
        assert (reach.inner.beyond(i, centre + corners * reach.box.half_m) <= 1e-9).all()
        wrists = centre + corners * reach.box.half_m + [0.0, 0.0, reach.outer.above_m]
        assert (reach.outer.beyond(i, wrists) <= 1e-9).all()
    sides = np.sign(reach.box.centre_b_m)
    np.testing.assert_allclose(reach.inner.centre_b_m * sides, np.abs(reach.inner.centre_b_m[[0]]).repeat(4, axis=0))


def test_a_polygon_leaves_out_what_is_not_reached_but_in_the_box_that_it_goes_around() -> None:
    points = np.stack(np.meshgrid(np.arange(-5.0, 6.0), np.arange(-5.0, 6.0), indexing="ij"), axis=-1).reshape(-1, 2)
    corners = np.array([[-2.0, -2.0], [-2.0, 2.0], [2.0, -2.0], [2.0, 2.0]])
    missing = np.array([[1.0, 0.0], [4.0, 1.0]])  # one of them in the box
    ok = ~(points[:, None] == missing).all(axis=2).any(axis=1)
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    assert workspace._polygon(points, ok, normals, corners).tolist() == [3.0, 5.0, 5.0, 5.0]


def test_what_a_robot_reaches_is_computed_once(
    robot: Robot, reach: LimbReach, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(build, "_KNOWN", {})
    first = reach_of(robot, reach.inner.max_tilt_rad)
    assert reach_of(robot, reach.inner.max_tilt_rad) is first
    (file,) = kept.cache_folder().iterdir()
    build._KNOWN.clear()  # as another process
    with monkeypatch.context() as patch:
        patch.setattr(workspace, "acceptance_boxes", lambda *_: pytest.fail("computed again"))
        np.testing.assert_array_equal(reach_of(robot, reach.inner.max_tilt_rad).inner.extent_m, reach.inner.extent_m)
    build._KNOWN.clear()
    file.write_bytes(file.read_bytes()[:100])
    np.testing.assert_array_equal(reach_of(robot, reach.inner.max_tilt_rad).inner.extent_m, reach.inner.extent_m)


def test_a_damaged_file_of_reach_is_not_believed(tmp_path: Path) -> None:
    """Any byte changed, anywhere: also where a number still reads as a number."""
    path, random = tmp_path / "reach.npz", np.random.default_rng(3)
    kept._write(path, {"box": np.linspace(0.0, 1.0, 12), "tilt": np.array(0.1)})
    written = path.read_bytes()
    assert kept._read(path) is not None
    for place in random.integers(0, len(written), 300):
        damaged = bytearray(written)
        damaged[place] ^= int(random.integers(1, 256))
        path.write_bytes(damaged)
        assert kept._read(path) is None
    for length in (0, 31, 32, len(written) - 1):
        path.write_bytes(written[:length])
        assert kept._read(path) is None
