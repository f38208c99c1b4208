"""Equations (5) to (9a), the gap (C2), what wrenches lack between the knots (C3), and tumbling (C6)."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from typing import Any

import casadi as ca
import numpy as np
import pytest
from crux_planner.certificates.bound.bound_worker import gap
from crux_planner.checker.bounds import check_bounds
from crux_planner.checker.cost import cost
from crux_planner.checker.dynamics import check_dynamics
from crux_planner.checker.equilibrium import correction, shared_load, tumble_margin
from crux_planner.checker.limit_surface import finger_loads
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import sample
from crux_planner.checker.terminal import check_ends
from crux_planner.model.kinematics import rotation_z
from crux_planner.physics.bounds import body_bounds
from crux_planner.physics.cost import body_cost, plan_cost, wrench_cost
from crux_planner.physics.reach import offset_in_body
from crux_planner.trajectory.stage_functions import COLUMN, StageFunctions
from crux_planner.trajectory.stage_problem import StageProblem
from scipy.spatial.transform import Rotation

from .random_plan import N, RandomPlan, draw
from .test_contact import worst

POSITION, ORIENTATION, VELOCITY, WRENCH, LIFT, OPENING, SWITCHING = 1.7, 0.6, 8.0, 3e-4, 0.13, 0.21, 0.37


@pytest.fixture(scope="module", params=[0, 1])
def plan(request: pytest.FixtureRequest) -> RandomPlan:
    return draw(request.param)


def rotations(rpy: np.ndarray) -> np.ndarray:
    """R_WB (..., 3, 3)."""
    return np.asarray(Rotation.from_euler("xyz", rpy).as_matrix())


def rate_map(rpy: np.ndarray) -> np.ndarray:
    """E(theta) by differences: omega of a unit rate of roll, pitch or yaw, in B."""
    step, columns = 1e-6, []
    for unit in np.eye(3):
        ends = [rotations(rpy + side * step * unit) for side in (-0.5, 0.5)]
        columns.append(Rotation.from_matrix(rotations(rpy).T @ ends[1] @ ends[0].T @ rotations(rpy)).as_rotvec() / step)
    return np.column_stack(columns)


def knot_costs(plan: RandomPlan) -> np.ndarray:
    """J (6) of every knot, (N + 1,), its terms one after another."""
    arrays, body, air = plan.arrays, plan.scenario.goal.body, ~plan.arrays.stance
    q = POSITION * ((arrays.body_position - body.position_m) ** 2).sum(axis=1)
    q += ORIENTATION * ((arrays.body_rpy - body.rpy_rad) ** 2).sum(axis=1)
    q += VELOCITY * ((arrays.body_velocity**2).sum(axis=1) + (arrays.body_rate**2).sum(axis=1))
    k_m = 2 / 3 * plan.scenario.contact.patch_radius_m
    efforts = (arrays.finger_force**2).sum(axis=(1, 2, 3)) + (arrays.finger_moment**2).sum(axis=(1, 2, 3)) / k_m**2
    efforts[N] = 0.0
    lifted = -LIFT * (air * arrays.gripper_position[..., 2]).sum(axis=1)
    opened = -OPENING * (air * arrays.separation).sum(axis=1)
    changes = np.array([sum(air[t, limb] != air[t + 1, limb] for limb in range(4)) for t in range(N)] + [0])
    return np.asarray(q + WRENCH * efforts + lifted + opened + SWITCHING * changes)


def test_equation_5_the_cost_is_the_sum_over_the_knots_and_the_goal_is_met(plan: RandomPlan) -> None:
    assert cost(plan.arrays, plan.scenario) == pytest.approx(knot_costs(plan).sum(), rel=1e-12)
    findings, goal = Findings(), plan.scenario.goal
    check_ends(plan.arrays, plan.scenario, findings)
    off = np.linalg.norm(plan.arrays.body_position[N] - goal.body.position_m)
    assert worst(findings)["goal_position"] == pytest.approx(off - goal.tolerance_m)
    turned = Rotation.from_matrix(rotations(plan.arrays.body_rpy[N]).T @ rotations(np.array(goal.body.rpy_rad)))
    assert worst(findings)["goal_orientation"] == pytest.approx(turned.magnitude() - goal.tolerance_rad, abs=1e-9)
    low, high = body_bounds(plan.problem, None)
    begin = [*plan.problem.start.position_m, *plan.problem.start.rpy_rad, *[0.0] * 6]
    assert low[0].tolist() == high[0].tolist() == begin
    assert np.abs(np.array([low[N, :3], high[N, :3]]) - plan.problem.goal.body.position_m).max() < goal.tolerance_m


def test_equation_6_the_planners_terms_of_a_knot(plan: RandomPlan) -> None:
    """Body, wrenches and contacts, in the planner's own frame."""
    problem, body, schedule = plan.problem, plan.solution.body, plan.schedule
    goal, k_m, total = problem.goal.body, problem.patch.k_m, 0.0
    for t, x in enumerate(body):
        q = POSITION * ((x[:3] - goal.position_m) ** 2).sum() + ORIENTATION * ((x[3:6] - goal.rpy_rad) ** 2).sum()
        q += VELOCITY * (x[6:] ** 2).sum()
        assert float(body_cost(ca.DM(x), problem)) == pytest.approx(q, rel=1e-12)
        total += q
        for s_1, s_2, m, n_1, n_2 in plan.solution.wrenches[t].values() if t < N else ():
            u = WRENCH * (2 * (s_1**2 + s_2**2 + (m / k_m) ** 2) + n_1**2 + n_2**2)
            assert float(wrench_cost(ca.DM([s_1, s_2, m, n_1, n_2]), problem)) == pytest.approx(u, rel=1e-12)
            total += u
        total -= sum(
            LIFT * schedule.poses[t, i, 2] + OPENING * 2 * schedule.poses[t, i, 4] for i in range(4) if plan.air[t, i]
        )
        total += SWITCHING * (plan.air[t] != plan.air[t + 1]).sum() if t < N else 0.0
    assert plan_cost(problem, schedule, body, plan.solution.wrenches) == pytest.approx(total, rel=1e-12)


def test_equation_7_bounds_of_planner_and_checker_are_those_of_the_robot(plan: RandomPlan) -> None:
    arrays, robot, findings = plan.arrays, plan.robot, Findings()
    check_bounds(arrays, robot, False, False, findings)
    along = arrays.body_velocity @ rotation_z(float(arrays.body_rpy[0, 2]))
    apart = np.linalg.norm(np.diff(arrays.gripper_position, axis=0), axis=2).max() / arrays.dt_s
    height, (low, high) = arrays.body_position[:, 2], robot.body.height_m
    half = arrays.separation / 2
    yaw = np.remainder(arrays.gripper_yaw - arrays.body_rpy[:, None, 2] + np.pi, 2 * np.pi) - np.pi
    wanted = {
        "body_height": max(low - height.min(), height.max() - high),
        "body_tilt": np.abs(arrays.body_rpy[:, :2]).max() - robot.body.max_tilt_rad,
        "body_speed": np.abs(along).max() - robot.body.max_speed_m_s,
        "body_rate": np.abs(arrays.body_rate).max() - robot.body.max_rate_rad_s,
        "finger_opening": max(robot.gripper.opening_m[0] - half.min(), half.max() - robot.gripper.opening_m[1]),
        "gripper_yaw": max(robot.grasp.gripper_yaw_rad[0] - yaw.min(), yaw.max() - robot.grasp.gripper_yaw_rad[1]),
        "swing_height": arrays.gripper_position[..., 2].max() - robot.grasp.max_swing_height_m,
        "swing_speed": apart - robot.grasp.approach_speed_m_s,
    }
    found = worst(findings)
    assert {name: found[name] for name in wanted} == pytest.approx(wanted, abs=1e-9)
    within, (least, most) = slice(1, N), body_bounds(plan.problem, None)
    assert (least[within, 2] == low).all()
    assert (most[within, 2] == high).all()
    speeds = [robot.body.max_speed_m_s] * 3 + [robot.body.max_rate_rad_s] * 3
    np.testing.assert_allclose(most[within, 6:], np.tile(speeds, (N - 1, 1)), rtol=2e-3)
    assert (most[within, 6:] <= speeds).all()
    assert (most[within, 3:5] <= robot.body.max_tilt_rad).all()


def test_equation_8a_the_body_moves_as_forces_push_it(plan: RandomPlan) -> None:
    arrays, findings, mass = plan.arrays, Findings(), plan.problem.mass_kg
    check_dynamics(arrays, plan.centre_of_mass, mass, plan.problem.inertia_b, findings)
    accelerations = np.diff(arrays.body_velocity, axis=0) / arrays.dt_s
    slope = np.radians(45.0)
    g = 9.81 * np.array([-np.sin(slope), 0.0, -np.cos(slope)])
    left = mass * accelerations - arrays.finger_force[:N].sum(axis=(1, 2)) - mass * g
    assert worst(findings)["force_balance"] == pytest.approx(np.abs(left).max(), rel=1e-9)
    moved = np.diff(arrays.body_position, axis=0) - arrays.dt_s * arrays.body_velocity[:N]
    assert worst(findings)["position_step"] == pytest.approx(np.abs(moved).max(), rel=1e-9)
    turn = rotation_z(plan.problem.heading_rad)
    x, then = plan.solution.body[:N], next_states(plan)
    forces, _ = planned_wrenches(plan)
    wanted = x[:, 6:9] + arrays.dt_s * (forces.sum(axis=(1, 2)) / mass + g @ turn)
    np.testing.assert_allclose(then[:, 6:9], wanted, atol=1e-9)
    np.testing.assert_allclose(then[:, :3], x[:, :3] + arrays.dt_s * x[:, 6:9], atol=1e-12)


def next_states(plan: RandomPlan) -> np.ndarray:
    """(N, 12): where the exact P1 has the body go."""
    functions = StageFunctions(plan.problem)
    stages = StageProblem(functions, plan.problem, plan.schedule)
    columns = np.zeros((N, 4, COLUMN))
    for t, knot in enumerate(plan.solution.wrenches):
        for limb, q in knot.items():
            columns[t, limb, :5] = q / functions.scale
    return stages.next_states(plan.solution.body, columns)


def planned_wrenches(plan: RandomPlan) -> tuple[np.ndarray, np.ndarray]:
    """lambda and tau (N, 4, 2, 3) of the solution, in the planner's frame, by (4) and (13)."""
    force, moment = np.zeros((2, N, 4, 2, 3))
    for t, knot in enumerate(plan.solution.wrenches):
        for limb, (s_1, s_2, m, n_1, n_2) in knot.items():
            held = plan.schedule.contacts[t][limb]
            assert held is not None
            yaw = plan.problem.contacts[held].yaw_rad
            e, across = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
            force[t, limb] = s_1 * across + [0.0, 0.0, s_2] + np.outer([n_1, -n_2], e)
            moment[t, limb] = m * e
    return force, moment


def unspoilt(plan: RandomPlan) -> RandomPlan:
    """With grippers where the schedule has them, for the centre of mass, in the planner's frame."""
    poses, body = plan.schedule.poses, plan.solution.body
    where: dict[str, Any] = {
        "gripper_position": poses[..., :3],
        "gripper_yaw": poses[..., 3],
        "separation": 2 * poses[..., 4],
    }
    return replace(plan, arrays=replace(plan.arrays, body_position=body[:, :3], body_rpy=body[:, 3:6], **where))


def test_equation_8b_the_body_turns_about_the_centre_of_mass_of_the_whole_robot(plan: RandomPlan) -> None:
    arrays, findings, inertia = plan.arrays, Findings(), plan.problem.inertia_b
    check_dynamics(arrays, plan.centre_of_mass, plan.problem.mass_kg, inertia, findings)
    left, turned, wanted = [], [], []
    (force, moment), in_plan = planned_wrenches(plan), unspoilt(plan)
    for t in range(N):
        r_m, omega = plan.centre_of_mass[t], arrays.body_rate[t]
        torque = np.cross(plan.fingers[t] - r_m, arrays.finger_force[t]) + arrays.finger_moment[t]
        spin = inertia @ (arrays.body_rate[t + 1] - omega) / arrays.dt_s + np.cross(omega, inertia @ omega)
        left.append(spin - rotations(arrays.body_rpy[t]).T @ torque.sum(axis=(0, 1)))
        rates = arrays.body_rpy[t + 1] - arrays.body_rpy[t]
        turned.append(rate_map(arrays.body_rpy[t]) @ rates - arrays.dt_s * omega)
        x = plan.solution.body[t]
        torque = np.cross(in_plan.fingers[t] - in_plan.centre_of_mass[t], force[t]) + moment[t]
        about = rotations(x[3:6]).T @ torque.sum(axis=(0, 1)) - np.cross(x[9:], inertia @ x[9:])
        theta = x[3:6] + arrays.dt_s * np.linalg.solve(rate_map(x[3:6]), x[9:])
        wanted.append([*theta, *(x[9:] + arrays.dt_s * np.linalg.solve(inertia, about))])
    assert worst(findings)["moment_balance"] == pytest.approx(np.abs(left).max(), rel=1e-9)
    assert worst(findings)["orientation_step"] == pytest.approx(np.abs(turned).max(), rel=1e-6)
    np.testing.assert_allclose(next_states(plan)[:, [3, 4, 5, 9, 10, 11]], wanted, atol=1e-5)


def test_equation_9a_grippers_are_within_reach_and_range_of_yaw(plan: RandomPlan) -> None:
    random, reach = np.random.default_rng(4), plan.problem.limb_reach.inner
    assert len(reach.directions) > 3
    assert (reach.directions[:3] == np.eye(3)).all()
    inside = []
    for x in plan.solution.body:
        for limb in range(4):
            place = x[:3] + rotations(x[3:6]) @ (reach.centre_b_m[limb] + random.uniform(-1, 1, 3) * reach.half_m)
            offset = rotations(x[3:6]).T @ (place - x[:3])
            shown = np.array(offset_in_body(ca.DM(x[:3]), ca.DM(x[3:6]), ca.DM(place))).ravel()
            np.testing.assert_allclose(shown, offset, atol=1e-12)
            middle, extent = reach.middle_m[limb], reach.extent_m[limb]
            within = bool((np.abs(reach.directions @ offset - middle) <= extent).all())
            assert bool((reach.beyond(limb, shown) <= 0).all()) == within
            inside.append(within)
    assert 0.1 < np.mean(inside) < 1.0
    low, high = body_bounds(plan.problem, plan.schedule)
    yaws, (least, most) = plan.schedule.poses[1:N, :, 3], plan.robot.grasp.gripper_yaw_rad
    np.testing.assert_allclose(high[1:N, 5], (yaws - least).min(axis=1))
    np.testing.assert_allclose(low[1:N, 5], (yaws - most).max(axis=1))


def test_equation_c2_the_gap() -> None:
    assert gap(8.0, 6.0) == (8.0 - 6.0) / 8.0
    assert gap(8.0, None) is None


def test_equation_c3_what_blended_wrenches_lack_about_the_centre_of_mass(plan: RandomPlan) -> None:
    samples, random = sample(plan.arrays), np.random.default_rng(3)
    r_m = samples.body_position + random.normal(size=(len(samples.time_s), 3)) * 0.05
    shared, left = shared_load(samples, r_m, None, 0.02)
    lacks = -(np.cross(samples.gripper_position - r_m[:, None], samples.force) + samples.moment).sum(axis=1)
    found = correction(samples, shared, r_m)
    assert found.moment_Nm == pytest.approx(np.linalg.norm(lacks, axis=1).max(), rel=1e-12)
    added = shared.force - samples.force
    made_up = (np.cross(samples.gripper_position - r_m[:, None], added) + shared.moment - samples.moment).sum(axis=1)
    enough = left < 1e-9
    assert enough.mean() > 0.3
    np.testing.assert_allclose(made_up[enough], lacks[enough], atol=1e-6)
    assert found.force_N == pytest.approx(np.linalg.norm(added, axis=2).max(), rel=1e-12)


def test_equation_c6_the_tumble_margin(plan: RandomPlan) -> None:
    arrays, mass, gravity = plan.arrays, plan.problem.mass_kg, plan.arrays.gravity_w
    loads = finger_loads(arrays, plan.scenario.wall.friction)
    force, _ = plan.local
    found = float("inf")
    for t in range(N):
        stance, place = np.flatnonzero(~plan.air[t]), arrays.gripper_position[t]
        for one, two in permutations(stance, 2):
            along = place[two, :2] - place[one, :2]
            e_12 = np.array([*(along / np.linalg.norm(along)), 0.0])
            others = [limb for limb in stance if limb not in (one, two)]
            left_of = {limb: np.cross(e_12, place[limb] - place[one])[2] for limb in others}
            if any(off < 0 for off in left_of.values()):
                continue
            pull = 0.0
            for limb, off in left_of.items():
                normal = np.maximum(force[t, limb, :, 2], 0.0)
                pull += off * (loads.friction[t, limb] * normal + loads.spine_shear_N[t, limb]).sum()
            weight = e_12 @ np.cross(plan.centre_of_mass[t] - place[one], mass * gravity)
            found = min(found, float(pull - weight) / (mass * 9.81))
    assert tumble_margin(arrays, loads, plan.centre_of_mass, mass) == pytest.approx(found, rel=1e-9)
