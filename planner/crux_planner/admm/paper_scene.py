"""What P2a in the paper's form is made of: fingers, graspable faces, obstacles, reach, for climbs and walks alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.problem import BodyBounds, Goal, Pose, Problem, Weights
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem, build_walk
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.physics.reach import turned as turned_reach

FLOOR_HALF_M = 2.0  # of the surface that feet stand on
SIDES = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0, 0, 1.0]])  # outward: +x, -x, +y, -y, top


@dataclass(frozen=True)
class PaperScene:
    """Fingers i, faces c, obstacles v with 5 faces h (the sixth stands on the wall)."""

    steps: int
    dt_s: float
    mass_kg: float
    gravity_h: Array
    start: Pose
    goal: Goal
    body: BodyBounds
    weights: Weights
    effort: float  # R on a finger's force^2 and (moment / k)^2
    limb: Indices  # (nf,) of a finger
    reach_b_m: Array  # (4, 3) middle, of a limb's gripper or foot
    reach_half_m: Array
    yaw_rad: tuple[float, float]
    separation_m: float  # largest between two paired fingers
    step_m: float  # a finger's largest way in a knot
    top_m: float  # largest height of a finger
    start_h_m: Array  # (nf, 3)
    end_h_m: Array  # (nf, 3) NaN where free
    end_slack_m: float
    start_face: Indices  # (nf,)
    end_face: Indices  # (nf,) -1 where free
    normal: Array  # (C, 3) outward
    along: Array  # (C, 2, 3) tangents
    centre: Array  # (C, 3)
    half_m: Array  # (C, 2) where a patch's middle may be
    friction: Array  # (C,)
    spine: Array  # (C, 2) shear, twist
    k_m: float  # 0: point contacts, no moments
    largest_N: float
    opposite: Indices  # (C,) face that the other finger of a pair grips, -1 for none
    boxes: tuple[Array, Array]  # outward normals (V, 5, 3), and what n . p must reach (V, 5)


def paper_scene(scenario: Scenario, robot: Robot) -> PaperScene:
    """Either kind. Raises ScenarioError and InfeasibleError."""
    return _walk(scenario, robot) if scenario.contact.model == "point" else _climb(scenario, robot)


def _climb(scenario: Scenario, robot: Robot) -> PaperScene:
    problem, patch = build_problem(scenario, robot), scenario.contact.patch_radius_m
    cuboids, share = problem.cuboids, problem.friction_share
    least = 1.0 - (scenario.uncertainty.friction if scenario.uncertainty else 0.0)
    turns = [rotation_z(float(yaw)) for yaw in cuboids.yaw_rad]
    middles = np.column_stack([cuboids.foot_h_m, cuboids.half_m[:, 2]])
    normals = np.stack([SIDES @ turn.T for turn in turns])  # (V, 5, 3)
    reaches = np.stack([np.abs(SIDES) @ half for half in cuboids.half_m]) + np.einsum("vhi,vi->vh", normals, middles)
    tangents = np.array([[[0.0, 1, 0], [0, 0, 1]]] * 2 + [[[1.0, 0, 0], [0, 0, 1]]] * 2 + [[[1.0, 0, 0], [0, 1, 0]]])
    many = len(problem.hold_names)
    extents = [np.einsum("hai,i->ha", np.abs(tangents), cuboids.half_m[v]) - patch for v in range(many)]
    points = [middles[v] + SIDES * cuboids.half_m[v] @ turns[v].T for v in range(many)]
    starts = [problem.contacts[c] for c in problem.start_contacts]
    end_face = np.full(8, -1)
    for limb, (hold, pair) in problem.goal.grasps.items():
        end_face[2 * limb : 2 * limb + 2] = 5 * hold + 2 * pair + np.array([0, 1])
    spiny = np.array([[float(s) for s in hold.spines] for hold in scenario.holds]).ravel()
    turned = max(abs(problem.start.rpy_rad).max(), abs(problem.goal.body.rpy_rad).max())
    return PaperScene(
        **_common(problem),
        effort=problem.weights.wrench,
        limb=np.repeat(np.arange(4), 2),
        reach_b_m=problem.boxes.centre_b_m,
        reach_half_m=turned_reach(problem.boxes, float(turned)).half_m,
        yaw_rad=problem.gripper_yaw_rad,
        separation_m=2 * problem.shape.largest_opening,
        step_m=problem.swing.speed_m_s * problem.dt_s,
        top_m=problem.swing.max_height_m,
        start_h_m=np.array([c.centre_h_m + sign * c.separation_m / 2 * c.axis for c in starts for sign in (1, -1)]),
        end_h_m=np.full((8, 3), np.nan),
        end_slack_m=0.0,
        start_face=np.array([5 * c.hold + face for c in starts for face in (c.finger1_face, c.finger1_face ^ 1)]),
        end_face=end_face,
        normal=normals[:many].reshape(-1, 3),
        along=np.concatenate([tangents @ turns[v].T for v in range(many)]),
        centre=np.concatenate(points),
        half_m=np.concatenate(extents),
        friction=least * share * np.array([hold.friction for hold in scenario.holds]).ravel(),
        spine=share * spiny[:, None] * np.array([problem.patch.spine_shear_N, problem.patch.spine_twist_Nm]),
        k_m=problem.patch.k_m,
        largest_N=share * problem.patch.max_normal_N,
        opposite=np.concatenate([5 * v + np.array([1, 0, 3, 2, -1 - 5 * v]) for v in range(many)]),
        boxes=(normals, reaches),
    )


def _walk(scenario: Scenario, robot: Robot) -> PaperScene:
    problem = build_walk(scenario, robot)
    turned = abs(float(problem.goal.body.rpy_rad[2]))
    return PaperScene(
        **_common(problem),
        effort=FORCE_SHARE * problem.weights.wrench,
        limb=np.arange(4),
        reach_b_m=problem.boxes.centre_b_m,
        reach_half_m=turned_reach(problem.boxes, turned).half_m,
        yaw_rad=problem.foot_yaw_rad,
        separation_m=0.0,
        step_m=problem.foot_speed_m_s * problem.dt_s,
        top_m=problem.step_height_m,
        start_h_m=np.column_stack([problem.start_feet_h_m, np.zeros(4)]),
        end_h_m=np.column_stack([problem.goal_feet_h_m, np.zeros(4)]),
        end_slack_m=FINAL_FOOT_M,
        start_face=np.zeros(4, dtype=int),
        end_face=np.zeros(4, dtype=int),
        normal=np.array([[0.0, 0, 1]]),
        along=np.array([[[1.0, 0, 0], [0, 1, 0]]]),
        centre=np.zeros((1, 3)),
        half_m=np.full((1, 2), FLOOR_HALF_M),
        friction=np.array([problem.friction]),
        spine=np.zeros((1, 2)),
        k_m=0.0,
        largest_N=problem.max_normal_N,
        opposite=np.array([-1]),
        boxes=(np.zeros((0, 5, 3)), np.zeros((0, 5))),
    )


def _common(problem: Problem | WalkProblem) -> dict[str, Any]:
    names = ("steps", "dt_s", "mass_kg", "gravity_h", "start", "goal", "body", "weights")
    return {name: getattr(problem, name) for name in names}
