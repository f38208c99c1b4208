"""Walking plans on point feet: what `plan` gives, judged by the checker and by hand."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_planner import InfeasibleError, PlanResult
from crux_planner.checker.kinematics import check_kinematics
from crux_planner.checker.limb_model import load_model
from crux_planner.checker.plan_arrays import PlanArrays, read_plan
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import on_pads, sample
from crux_planner.errors import HorizonError, unsolved
from crux_planner.model.arrays import Array
from crux_planner.model.gait import LEAST_AIR, Gait, Step, longest_step
from crux_planner.model.slots import Strides
from crux_planner.model.walk_problem import FINAL_FOOT_M, USUAL, build_walk
from crux_planner.pipeline import walk as walking
from crux_planner.pipeline.walk_contacts import WalkContacts
from crux_planner.solvers import clock
from crux_planner.trajectory.walk_qp import solve
from shared_plans import unproven

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"
ROBOT = load_robot("scaler")
FLAT = (SCENES / "walk-flat.yaml").read_text()


def walk(text: str) -> PlanResult:
    return unproven(parse_scenario(text), ROBOT)


def test_the_flat_walk_by_hand() -> None:
    """Checked here without the checker: Newton's law, the cone, feet that rest in stance and stand on the surface."""
    result = walk(FLAT)
    assert result.ok
    assert sorted(result.gait) == ["LF", "LR", "RF", "RR"]
    knots, dt = result.plan.knots, result.plan.dt_s
    force = np.array(
        [[np.add(limb.finger_force_w_n[:3], limb.finger_force_w_n[3:]) for limb in k.limbs] for k in knots]
    )
    velocity = np.array([knot.body_velocity_w_m_s for knot in knots])
    wanted = ROBOT.total_mass_kg * (np.diff(velocity, axis=0) / dt + np.array([0.0, 0.0, 9.81]))
    np.testing.assert_allclose(force[:-1].sum(axis=1), wanted, atol=0.01)
    lateral = np.hypot(force[..., 0], force[..., 1])
    assert (lateral <= 0.6 * force[..., 2] + 1e-6).all()
    feet = np.array([[limb.gripper_position_w_m for limb in knot.limbs] for knot in knots])
    standing = np.array([[limb.phase == limb.STANCE for limb in knot.limbs] for knot in knots])
    assert (feet[standing][:, 2] == 0.0).all()
    moved = np.abs(np.diff(feet, axis=0)).max(axis=2)
    assert (moved[standing[:-1]] < 1e-9).all()
    assert (standing.sum(axis=1) >= 3).all()
    assert np.linalg.norm(np.subtract(knots[-1].body_position_w_m, [0.1, 0.0, 0.185])) < 0.01
    # Three feet carry what four do: the polygon of those in stance holds the body's middle over its loads.
    foot_load = force[:-1, :, 2]
    pressure = np.einsum("kl,kli->ki", foot_load, feet[:-1, :, :2]) / foot_load.sum(axis=1)[:, None]
    assert np.abs(pressure - np.array([k.body_position_w_m[:2] for k in knots[:-1]])).max() < 0.05


@pytest.mark.parametrize(
    ("change", "to"),
    [
        ("position_m: [0.1, 0.0, 0.185]", "position_m: [0.05, 0.04, 0.19], rpy_deg: [0, 0, 8]"),
        ("position_m: [0.1, 0.0, 0.185]", "position_m: [0.0, 0.0, 0.185]"),
        ("slope_deg: 0", "slope_deg: 10"),
        pytest.param(
            "position_m: [0.1, 0.0, 0.185]",
            "position_m: [0.05, 0.0, 0.185], rpy_deg: [0, 0, 15]",
            marks=pytest.mark.sweep,
        ),
        ("position_m: [0.1, 0.0, 0.185]", "position_m: [0.18, 0.0, 0.185], rpy_deg: [0, 0, 5]"),
    ],
)
def test_other_walks_pass_the_check(change: str, to: str) -> None:
    text = FLAT.replace(change, to)
    assert text != FLAT
    assert walk(text).check.ok


def test_the_shipped_slope_is_the_flat_walk_uphill() -> None:
    assert parse_scenario((SCENES / "walk-slope.yaml").read_text()).wall.slope_deg == 10


def test_three_feet_keep_their_load_when_the_limbs_mass_is_counted() -> None:
    """At both ends of every interval on three feet, every link a point mass where the checker's kinematics have it, and
    with the second difference of its places at the knots.
    """
    result = walk((SCENES / "walk-slope.yaml").read_text())
    arrays = read_plan(result.plan, Findings())
    assert arrays is not None
    masses, places = _links(arrays)
    pull = np.full_like(places, -arrays.gravity_w)
    pull[:, 1:-1] += np.diff(places, 2, axis=1) / result.plan.dt_s**2
    force = np.einsum("l,lki->ki", masses, pull)
    moment = np.einsum("l,lki->ki", masses, np.cross(places, pull))
    pressure = np.stack([-moment[:, 1], moment[:, 0]], axis=1) / force[:, 2:]
    shares = []
    for k in np.flatnonzero(arrays.stance[:-2].sum(axis=1) == 3):
        corners = np.vstack([arrays.gripper_position[k, arrays.stance[k], :2].T, np.ones(3)])
        shares += [np.linalg.solve(corners, np.append(point, 1.0)).min() for point in pressure[k : k + 2]]
    assert min(shares) == pytest.approx(0.07, abs=0.002)


def test_where_a_foot_would_have_to_pull_all_are_told_to_press_harder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planned without rows between the knots the check refuses the walk; so the next attempt has them."""
    blind = replace(USUAL, between_share=-np.inf)
    monkeypatch.setattr(walking, "USUAL", blind)
    refused: list[InfeasibleError] = []
    firmer = walking._firmer

    def firmer_where_refused(attempt: walking.Walk, reason: InfeasibleError) -> walking.Walk | None:
        refused.append(reason)
        return firmer(attempt, reason)

    monkeypatch.setattr(walking, "_firmer", firmer_where_refused)
    assert walk(FLAT.replace("steps: 40", "steps: 32")).ok
    assert {reason.constraint for reason in refused} == {"foot_pull"}
    assert re.search(r"fails the check: foot_pull by \d\.\d+ N", str(refused[0]))


def _links(arrays: PlanArrays) -> tuple[Array, Array]:
    """Masses (L,) and centres of mass (L, N, 3) in W of all links at the knots but the last."""
    samples, model = on_pads(sample(arrays), ROBOT.gripper.pad_radius_m), load_model(ROBOT)
    motions, *_ = check_kinematics(samples, model, arrays.gravity_w, np.full(6, np.inf), Findings())
    placed = [(model.body.mass_kg, samples.body_position + samples.rotation @ model.body.com_m)]
    for limb, motion in zip(model.limbs, motions, strict=True):
        for link in limb.links:
            in_body = motion.state.link_position_m[link.name] + motion.state.link_rotation[link.name] @ link.com_m
            placed.append((link.mass_kg, samples.body_position + (samples.rotation @ in_body[..., None])[..., 0]))
    knots = np.searchsorted(samples.interval, np.arange(arrays.n_knots - 1))
    return np.array([mass for mass, _ in placed]), np.array([place[knots] for _, place in placed])


def test_a_step_begins_and_ends_at_rest_and_is_highest_in_the_middle() -> None:
    way, height = Step(0, 4, 10).shares()
    assert way[[0, 3, 6]] == pytest.approx([0.0, 0.5, 1.0])
    assert height[[0, 3, 6]] == pytest.approx([0.0, 1.0, 0.0])
    gait = Gait((Step(0, 4, 10), Step(0, 12, 18)), np.array([0.5, 1.0]), 21)
    assert gait.blend.sum(axis=2) == pytest.approx(np.ones((21, 4)))
    assert gait.blend[11, 0].argmax() == 4
    assert gait.blend[18, 0].argmax() == 5
    assert gait.stance[:, 0].tolist() == [True] * 4 + [False] * 6 + [True] * 2 + [False] * 6 + [True] * 3


def test_a_search_begins_with_every_order_of_the_feet_and_steps_as_long_as_they_must_be() -> None:
    problem = build_walk(parse_scenario(FLAT), ROBOT)
    strides = Strides(problem)
    starts = strides.starts(1)
    assert len(set(starts)) == 24
    assert all(slots.possible(problem) and strides.long_enough(slots) for slots in starts)
    swings = np.linalg.norm(problem.goal_feet_h_m - problem.start_feet_h_m, axis=1)
    for limb, ((lift, land),) in enumerate(starts[0].of_limb):
        shorter = Step(limb, lift, land - 1)
        assert longest_step(problem, Step(limb, lift, land)) >= swings[limb] - FINAL_FOOT_M
        assert land - lift == LEAST_AIR or longest_step(problem, shorter) < swings[limb]
    with pytest.raises(InfeasibleError, match="need at least"):
        strides.starts(4)


def test_a_foot_that_turns_far_is_in_the_air_for_longer() -> None:
    """15 degrees: (7) bounds the foot's rate of yaw, too."""
    problem = build_walk(parse_scenario(FLAT.replace("0.185], tol", "0.185], rpy_deg: [0, 0, 15], tol")), ROBOT)
    slots = Strides(problem).starts(1)[0]
    for ((lift, land),) in slots.of_limb:
        rates = np.abs(np.diff(Step(0, lift, land).shares()[0])) * np.radians(15) / problem.dt_s
        assert rates.max() <= problem.foot_yaw_rate_rad_s


@pytest.mark.parametrize(
    ("change", "to", "error", "text"),
    [
        pytest.param("friction: 0.6", "friction: 0.0", InfeasibleError, None, marks=pytest.mark.sweep),
        ("slope_deg: 0", "slope_deg: 35", InfeasibleError, "needs a friction of 0.70"),
        ("slope_deg: 0", "slope_deg: 90", InfeasibleError, "no friction is enough"),
        ("slope_deg: 0", "slope_deg: 100", InfeasibleError, "no friction is enough"),
        (
            "LF: [0.14, 0.36]",
            "LF: [0.14, 0.5]",
            ScenarioError,
            "start.feet.LF.*65 mm beyond the reach that crux plans with",
        ),
        ("position_m: [0.1, 0.0, 0.185]", "position_m: [1.5, 0.0, 0.185]", InfeasibleError, "horizon.steps"),
        (
            "horizon:",
            "obstacles: [{name: box, position_m: [0.22, 0.36], size_m: [0.05, 0.05, 0.06]}]\nhorizon:",
            InfeasibleError,
            "start.feet.LF is 27 mm too near to obstacle 'box'",
        ),
        (
            "horizon:",
            "holds: [{name: grip, position_m: [1, 1], size_m: [0.1, 0.1, 0.1], friction: 0.6}]\nhorizon:",
            ScenarioError,
            "grip",
        ),
        ("max_normal_N: 60", "max_normal_N: 60, spine_shear_N: 3", ScenarioError, "spine_shear_N"),
        pytest.param("max_normal_N: 60", "max_normal_N: 20", InfeasibleError, None, marks=pytest.mark.sweep),
    ],
)
def test_why_not(change: str, to: str, error: type[Exception], text: str | None) -> None:
    scenario = FLAT.replace(change, to)
    assert scenario != FLAT
    with pytest.raises(error, match=text):
        walk(scenario)


FAR = "position_m: [0.1914, 0.0035, 0.185], rpy_deg: [0, 0, 5.71]"
UPHILL = FLAT.replace("slope_deg: 0", "slope_deg: 10").replace("position_m: [0.1, 0.0, 0.185]", FAR)


@pytest.mark.sweep
@pytest.mark.parametrize(("text", "short", "enough"), [(FLAT, 23, 35), (UPHILL, 40, 60)])
def test_a_horizon_that_is_too_short_is_named_with_one_that_does(text: str, short: int, enough: int) -> None:
    message = rf"no plan found in {short} steps of 0\.08 s, but one in {enough}"
    with pytest.raises(HorizonError, match=message) as refused:
        walk(text.replace("steps: 40", f"steps: {short}"))
    assert refused.value.relaxed == {"constraint": "horizon", "amount": enough, "unit": "steps", "place": None}
    assert walk(text.replace("steps: 40", f"steps: {enough}")).ok


def test_answers_that_are_held_to_the_one_before_come_to_the_same_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long walks drift without that; here it must neither end short of (8) nor cost more. The first round is free: what
    three feet carry at the knot after is linear about a straight walk before it.
    """
    problem = build_walk(parse_scenario(FLAT), ROBOT)
    knots = next(WalkContacts(problem, many=0).search(clock.now() + 30))
    free = solve(problem, knots, clock.now() + 30)
    monkeypatch.setattr("crux_planner.trajectory.walk_qp._FREE_ROUNDS", 1)
    held = solve(problem, knots, clock.now() + 30)
    assert (free.status, held.status) == ("solved", "solved")
    assert held.position_residual_m != free.position_residual_m  # another way was taken
    assert held.cost == pytest.approx(free.cost, rel=5e-4)


def test_a_walk_that_ran_out_of_time_is_not_called_impossible() -> None:
    assert unsolved("LF", "Maximum_WallTime_Exceeded").constraint == "time limit"
    assert unsolved("LF", "Infeasible_Problem_Detected").constraint == "dynamics"
