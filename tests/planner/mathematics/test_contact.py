"""Equations (1) to (4), (9b), (10) to (14) and the margin (C1)."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from crux_planner.checker.contact import check_contact
from crux_planner.checker.geometry import signed_distance_to_box
from crux_planner.checker.limit_surface import check_limit_surface, cone_excess, finger_loads
from crux_planner.checker.report import Findings
from crux_planner.model.build import build_problem
from crux_planner.physics.dynamics import gripper_wrench
from crux_planner.physics.limit_surface import SMOOTHING_N, finger_forces, paper_directions, surface_slack
from crux_planner.trajectory.consensus import finger_positions
from scipy.optimize import minimize

from .random_plan import N, RandomPlan, Z, draw

POWER, K_M = 1.65, 0.0134


@pytest.fixture(scope="module", params=[0, 1])
def plan(request: pytest.FixtureRequest) -> RandomPlan:
    return draw(request.param)


def worst(findings: Findings) -> dict[str, float]:
    """The largest amount of every constraint."""
    return {each.constraint: each.amount for each in findings.worst()}


def disc(shear: np.ndarray, twist_as_force: np.ndarray) -> np.ndarray:
    """The left side of (2a)."""
    return np.asarray((shear**POWER + np.abs(twist_as_force) ** POWER) ** (1 / POWER))


def margin(
    f: np.ndarray, m: np.ndarray, mu: np.ndarray, sigma: np.ndarray, kappa: np.ndarray, k_m: float
) -> np.ndarray:
    """(C1) of forces (..., 3) and twists (...)."""
    q_x, q_y = (np.maximum(np.abs(f[..., j]) - sigma, 0.0) for j in (0, 1))
    q_m = np.maximum(np.abs(m) - kappa, 0.0)
    return np.asarray(mu * np.maximum(f[..., 2], 0.0) - disc(np.hypot(q_x, q_y), q_m / k_m))


def test_equation_1_a_finger_bears_the_sum_of_what_friction_and_spines_bear() -> None:
    """The best of all splits w = w_fr + w_sp, by a numeric search, against the checker's closed form."""
    random = np.random.default_rng(5)
    for _ in range(15):
        f, m = random.normal(size=2) * 15, random.normal() * 0.3
        mu, f_z, sigma, kappa = random.uniform([0.3, 1.0, 1.0, 0.01], [2.5, 30.0, 8.0, 0.1])

        def needed(split: np.ndarray, f: np.ndarray = f, m: float = m) -> float:
            rest = f - split[:2]
            return float(disc(np.hypot(*rest), (m - split[2] * K_M) / K_M))

        box = [(-sigma, sigma), (-sigma, sigma), (-kappa / K_M, kappa / K_M)]
        least = min(minimize(needed, random.uniform(*np.transpose(box)), bounds=box).fun for _ in range(4))
        spines = {"spine_shear_N": np.array(sigma), "spine_twist_Nm": np.array(kappa)}
        shown = cone_excess(f, np.array(m), np.array(f_z), friction=np.array(mu), patch_k_m=K_M, **spines)
        assert shown == pytest.approx(least - mu * f_z, abs=2e-3)


def test_equation_2_the_planners_cone_is_the_ellipsoid() -> None:
    random = np.random.default_rng(6)
    for _ in range(50):
        f_x, f_y, f_z, m = random.normal(size=4) * [20, 20, 10, 0.3] + [0, 0, 30, 0]
        mu = random.uniform(0.3, 2.5)
        wrench = ca.DM([f_x, f_y, m])
        slack = float(surface_slack("cone", wrench, ca.DM.zeros(3), mu * f_z, K_M))
        left = (f_x**2 + f_y**2) / (mu * f_z) ** 2 + m**2 / (K_M * mu * f_z) ** 2
        assert slack == pytest.approx(mu * f_z * (1 - np.sqrt(left + (SMOOTHING_N / (mu * f_z)) ** 2)), abs=1e-9)
        assert SMOOTHING_N == 0.05


def test_equation_2a_the_checkers_surface() -> None:
    random = np.random.default_rng(7)
    shear, twist = random.normal(size=(50, 2)) * 20, random.normal(size=50) * 0.3
    mu, none = random.uniform(0.3, 2.5, 50), np.zeros(50)
    edge = ((shear[:, 0] ** 2 + shear[:, 1] ** 2) ** (1.65 / 2) + np.abs(twist / K_M) ** 1.65) ** (1 / 1.65) / mu
    spines = {"spine_shear_N": none, "spine_twist_Nm": none}
    for share, inside in ((1.0 + 1e-9, True), (1.0 - 1e-9, False)):
        beyond = cone_excess(shear, twist, share * edge, friction=mu, patch_k_m=K_M, **spines)
        assert ((beyond <= 0) == inside).all()


def test_equation_3_spines_bear_a_box_without_normal_force(plan: RandomPlan) -> None:
    patch, contact = plan.problem.patch, plan.scenario.contact
    assert (patch.spine_shear_N, patch.spine_twist_Nm) == (contact.spine_shear_N, contact.spine_twist_Nm)
    box = np.array([contact.spine_shear_N, contact.spine_shear_N, contact.spine_twist_Nm])
    assert all((c.spines == box).all() for c in plan.problem.contacts)
    loads = finger_loads(plan.arrays, plan.scenario.wall.friction)
    on = ~plan.air
    assert (loads.spine_shear_N[on] == box[0]).all()
    assert (loads.spine_twist_Nm[on] == box[2]).all()
    corner = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3) * box
    for share, inside in ((1.0 - 1e-9, True), (1.0 + 1e-6, False)):
        f, m = share * corner[:, :2], share * corner[:, 2]
        spines = {"spine_shear_N": np.full(8, box[0]), "spine_twist_Nm": np.full(8, box[2])}
        beyond = cone_excess(f, m, np.zeros(8), friction=np.ones(8), patch_k_m=K_M, **spines)
        assert ((beyond <= 0) == inside).all()


def test_equation_c1_the_margin_of_every_finger(plan: RandomPlan) -> None:
    findings, (force, twist) = Findings(), plan.local
    shown = check_limit_surface(plan.arrays, plan.scenario, findings)
    friction = np.full((N + 1, 4, 2), np.nan)
    for k, limb in np.argwhere(~plan.air):
        hold, face = plan.arrays.hold[k, limb], plan.arrays.finger1_face[k, limb]
        friction[k, limb] = plan.arrays.cuboids.friction[hold, [face, face ^ 1]]
    contact = plan.scenario.contact
    box = np.array(contact.spine_shear_N), np.array(contact.spine_twist_Nm)
    found = margin(force, twist, friction, *box, contact.patch_k_m)
    assert shown == pytest.approx(np.nanmin(found), abs=1e-9)
    assert worst(findings)["limit_surface"] == pytest.approx(-np.nanmin(found), abs=1e-9)
    assert worst(findings)["normal_force_max"] == pytest.approx((force[~plan.air] @ Z).max() - contact.max_normal_N)


def test_equation_4_fingers_share_shear_and_twist(plan: RandomPlan) -> None:
    random = np.random.default_rng(8)
    yaw, q = 0.7, random.normal(size=5)
    axis, tangent = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    (f_1, f_2), (m_1, m_2) = finger_forces(q, axis, tangent)
    for along in (np.cross(Z, axis), Z):
        assert f_1 @ along == pytest.approx(f_2 @ along)
    assert m_1 @ axis == pytest.approx(m_2 @ axis)
    findings, (force, twist) = Findings(), plan.local
    check_limit_surface(plan.arrays, plan.scenario, findings)
    apart = np.abs(force[:, :, 0, :2] - force[:, :, 1, :2])[~plan.air].max()
    assert worst(findings)["equal_shear"] == pytest.approx(apart, abs=1e-9)
    assert worst(findings)["equal_twist"] == pytest.approx(np.abs(twist[..., 0] - twist[..., 1])[~plan.air].max())


def test_equation_9b_fingers_stand_apart_along_the_opening_axis(plan: RandomPlan) -> None:
    arrays = plan.arrays
    np.testing.assert_allclose(arrays.finger_position, plan.fingers, atol=1e-12)
    poses = [arrays.gripper_position, arrays.gripper_yaw[..., None], arrays.separation[..., None] / 2]
    of_planner = finger_positions(np.concatenate(poses, axis=2))
    np.testing.assert_allclose(of_planner.reshape(N + 1, 4, 2, 3), plan.fingers, atol=1e-12)


def test_equation_10a_a_touching_finger_rests_on_its_face(plan: RandomPlan) -> None:
    """In the checker, and every contact that the planner knows."""
    findings, cuboids = Findings(), plan.arrays.cuboids
    check_contact(plan.arrays, plan.scenario, plan.robot, findings)
    off, moved, aside = [], [], []
    for k, limb in np.argwhere(~plan.air):
        hold, face, radius = (
            plan.arrays.hold[k, limb],
            plan.arrays.finger1_face[k, limb],
            plan.scenario.contact.patch_radius_m,
        )
        depth, width = cuboids.size_m[hold, [face // 2, 1 - face // 2]]
        for finger in (0, 1):
            across, up, normal = plan.face_axes[k, limb, finger]
            away = plan.fingers[k, limb, finger] - cuboids.foot_w_m[hold]
            off.append(abs(away @ normal - depth / 2))
            beyond = radius - away @ up, away @ up - (cuboids.size_m[hold, 2] - radius)
            aside.append(max(abs(away @ across) - (width / 2 - radius), *beyond))
            if k < N:
                moved.append(np.abs(plan.fingers[k + 1, limb, finger] - plan.fingers[k, limb, finger]).max())
    found = worst(findings)
    assert found["contact_face"] == pytest.approx(max(off), abs=1e-9)
    assert found["contact_patch"] == pytest.approx(max(aside), abs=1e-9)
    assert found["contact_motion"] in (pytest.approx(max(moved), abs=1e-9), 1.0)
    for contact in build_problem(plan.scenario, plan.robot).contacts:
        half = plan.problem.cuboids.half_m[contact.hold][contact.pair]
        away = contact.centre_h_m[:2] - plan.problem.cuboids.foot_h_m[contact.hold]
        for side in (1, -1):
            assert side * contact.axis[:2] @ (away + side * contact.separation_m / 2 * contact.axis[:2]) == (
                pytest.approx(half, abs=1e-9)
            )


def test_equation_10b_a_finger_in_the_air_bears_nothing(plan: RandomPlan) -> None:
    findings = Findings()
    check_contact(plan.arrays, plan.scenario, plan.robot, findings)
    lambda_, tau = (v[plan.air] for v in (plan.arrays.finger_force, plan.arrays.finger_moment))
    assert worst(findings)["air_force"] == pytest.approx(np.linalg.norm(lambda_, axis=-1).max())
    assert worst(findings)["air_moment"] == pytest.approx(np.linalg.norm(tau, axis=-1).max())
    planned = [set(knot) for knot in plan.solution.wrenches]
    assert planned == [set(np.flatnonzero(~air)) for air in plan.air[:N]]


def test_equation_10c_a_finger_touches_one_face_at_most(plan: RandomPlan) -> None:
    """alpha of every finger and face of a hold, from the message; the fingers of a gripper are on opposite faces."""
    arrays = plan.arrays
    alpha = np.zeros((N + 1, 4, 2, len(arrays.cuboids.names), 4))
    for k, limb in np.argwhere(arrays.stance):
        face = arrays.finger1_face[k, limb]
        alpha[k, limb, [0, 1], arrays.hold[k, limb], [face, face ^ 1]] = 1
    sums = alpha.sum(axis=(3, 4))
    assert (sums <= 1).all()
    assert ((sums == 1).all(axis=2) == arrays.gripped).all()
    assert (arrays.stance == ~plan.air).all()
    for k, limb in np.argwhere(arrays.gripped):
        normals = plan.face_axes[k, limb, :, 2]
        np.testing.assert_allclose(arrays.face_normal[k, limb], normals, atol=1e-12)


def linear_rows(f: np.ndarray, m: float, most: float) -> bool:
    """(11)."""
    return bool((np.abs(f) <= most - abs(m) / K_M).all() and abs(m) <= K_M * most)


def test_equation_11_the_papers_rows() -> None:
    random = np.random.default_rng(9)
    directions, reach = paper_directions(K_M)
    held = []
    for _ in range(300):
        f, m, most = random.normal(size=2) * 10, random.normal() * 0.1, random.uniform(1.0, 20.0)
        held.append(linear_rows(f, m, most))
        assert bool((directions @ [*f, m] <= reach * most).all()) == held[-1]
        slack = surface_slack("paper", ca.DM([*f, m]), ca.DM.zeros(3), most, K_M)
        assert bool(ca.mmin(slack) >= 0) == held[-1]
    assert 0.1 < np.mean(held) < 0.9


def test_equation_12_needs_no_binary() -> None:
    random = np.random.default_rng(10)
    directions, reach = paper_directions(K_M)
    for _ in range(300):
        f, m, most = random.normal(size=2) * 10, random.normal() * 0.1, random.uniform(1.0, 20.0)
        found = False
        for gamma in (0, 1):
            plus, minus = (m, 0.0) if gamma else (0.0, -m)
            bounded = 0.0 <= plus <= gamma * K_M * most and 0.0 <= minus <= (1 - gamma) * K_M * most
            assert not bounded or plus + minus == abs(m)
            found |= bounded and bool((np.abs(f) <= most - (plus + minus) / K_M).all())
        assert bool((directions @ [*f, m] <= reach * most).all()) == found


def test_equation_13_wrenches_in_w_are_those_of_the_faces_turned(plan: RandomPlan) -> None:
    random = np.random.default_rng(11)
    loads = finger_loads(plan.arrays, plan.scenario.wall.friction)
    for k, limb in np.argwhere(~plan.air):
        for finger in (0, 1):
            local = [*loads.shear_N[k, limb, finger], loads.normal_N[k, limb, finger]]
            turned = plan.face_axes[k, limb, finger].T @ local
            np.testing.assert_allclose(turned, plan.arrays.finger_force[k, limb, finger], atol=1e-9)
            about = plan.face_axes[k, limb, 0, 2]
            rest = plan.arrays.finger_moment[k, limb, finger] - loads.twist_Nm[k, limb, finger] * about
            assert np.linalg.norm(rest) == pytest.approx(loads.other_moment_Nm[k, limb, finger], abs=1e-9)
    contact, q = plan.problem.contacts[0], random.normal(size=5)
    across = np.cross(Z, contact.axis)
    forces = [q[0] * across + q[1] * Z + n * z for n, z in ((q[3], contact.axis), (q[4], -contact.axis))]
    places = contact.centre_h_m + np.outer([0.03, -0.03], contact.axis)
    moment = np.cross(places, forces).sum(axis=0) + 2 * q[2] * contact.axis
    shown = gripper_wrench(*(ca.DM(v) for v in (q, contact.centre_h_m, contact.axis, contact.tangent)))
    np.testing.assert_allclose(
        np.concatenate([np.array(each).ravel() for each in shown]), [*np.sum(forces, axis=0), *moment], atol=1e-9
    )


def test_equation_14_a_point_is_outside_one_side_of_every_cuboid(plan: RandomPlan) -> None:
    random, cuboids, seen = np.random.default_rng(12), plan.problem.cuboids, []
    for _ in range(200):
        v = int(random.integers(len(cuboids.yaw_rad)))
        half, yaw = cuboids.half_m[v], cuboids.yaw_rad[v]
        o_v = np.array([*cuboids.foot_h_m[v], half[2]])
        p = o_v + random.uniform(-1.5, 1.5, 3) * half
        n_x, n_y = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        beta = [n @ (p - o_v) < s for axis, s in zip((n_x, n_y, Z), half, strict=True) for n in (axis, -axis)]
        outside = sum(beta) <= len(beta) - 1
        assert (cuboids.distance(p)[v] >= 0) == outside
        local = np.array([n_x, n_y, Z]) @ (p - o_v)
        assert (signed_distance_to_box(local, half) >= 0) == outside
        seen.append(outside)
    assert 0.1 < np.mean(seen) < 0.9
