"""How far joints turn for what a gripper moves: against small moves by the checker's inverse kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_planner.checker.geometry import rotation_about_z
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.model.joint_turns import joint_turns
from crux_planner.model.kinematics import inverse
from crux_planner.pipeline.first_wall import STEP_M, _Places, first_walls
from other_limbs import other_limbs

MOVE_M = 1e-4


@pytest.fixture(scope="module", params=["", "all of them"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    change = request.param
    return load_robot(other_limbs(change, tmp_path_factory.mktemp("robot")) if change else "scaler")


def moves(count: int) -> np.ndarray:
    """(count, 3) ways all around."""
    ways = np.random.default_rng(5).normal(size=(count, 3))
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


def test_joints_turn_as_small_moves_of_the_gripper_make_them(robot: Robot) -> None:
    limb, model = robot.limbs[0], load_model(robot).limbs[0]
    place, ways = limb.shoulder_b_m + np.array([0.02, 0.2, -0.15]), moves(400)
    q, reached = inverse(limb, place[None], np.eye(3)[None])
    assert reached.all()
    gains = np.array(robot.servo.position_gain_Nm_rad)
    found = joint_turns(limb, q, np.diag(gains))
    places = np.vstack([place, place + MOVE_M * ways])
    (others,) = solve([model], [places], [np.broadcast_to(np.eye(3), (len(places), 3, 3))])
    turned = (others.q_rad[1:] - others.q_rad[0]) / MOVE_M
    assert found.most_rad_m[0] == pytest.approx(np.abs(turned).max(axis=0), rel=0.03, abs=1e-3)
    assert found.stiffness_N_m[0] == pytest.approx((gains * turned**2).sum(axis=1).max(), rel=0.03)


def test_first_walls_tell_the_most_along_their_step(robot: Robot) -> None:
    model, walls = load_model(robot), list(first_walls(robot))
    assert walls
    for i, limb in enumerate(robot.limbs):
        wall = walls[i % len(walls)]
        x, y, z, yaw = wall.grippers_b[i]
        along = np.linspace(-0.5, 0.5, 4) * wall.stride_m
        places = np.array([[x + off, y, z] for off in along])
        turns = np.broadcast_to(rotation_about_z(np.array([yaw])), (len(places), 3, 3))
        q, reached = inverse(limb, places, turns)
        assert reached.all()
        (others,) = solve([model.limbs[i]], [places], [turns])
        off = np.minimum(others.q_rad - model.limbs[i].lower_rad, model.limbs[i].upper_rad - others.q_rad)
        assert wall.margin_rad[i] <= off.min() + 1e-3
        found = joint_turns(limb, q, np.diag(robot.servo.position_gain_Nm_rad))
        assert 0.5 * wall.turns_rad_m[i] < found.most_rad_m.max() < 1.02 * wall.turns_rad_m[i]
        assert found.stiffness_N_m.max() < 1.05 * wall.stiffness_N_m[i]


def test_a_step_is_where_joints_turn_little() -> None:
    shape = (2, 21, 9)
    turns = np.full(shape, 40.0)
    turns[1, 12:20, 2:7] = 9.0  # fewer places, at another yaw
    x, y = STEP_M * np.arange(21.0), STEP_M * np.arange(9.0)
    everywhere = np.ones(shape, dtype=bool)
    places = _Places(everywhere, everywhere[0], turns, 100 * turns, 2.0 / turns, np.array([0.0, 0.5]), x, y, -0.1)
    spot = places.spot(4 * STEP_M, 0.5, 0, 1.25)
    assert spot is not None
    assert spot[3:] == pytest.approx([0.5, 9.0, 900.0, 2.0 / 9.0])
    assert 14 * STEP_M <= spot[0] <= 17 * STEP_M
    wherever = places.spot(4 * STEP_M, 0.5, 0, np.inf)
    assert wherever is not None
    assert wherever[4] == 40.0


def test_where_nothing_is_held_there_is_no_step() -> None:
    nothing = np.zeros((1, 5, 5), dtype=bool)
    full = np.full(nothing.shape, np.inf)
    axis = STEP_M * np.arange(5.0)
    assert _Places(nothing, nothing[0], full, full, full, np.zeros(1), axis, axis, -0.1).spot(0.08, 0.5, 0, 2) is None
