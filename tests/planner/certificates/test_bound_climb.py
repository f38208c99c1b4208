"""The lower bound of a climb's J: below every plan, near the cheapest, and its parts against what they stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.admm.windows import Windows
from crux_planner.certificates.bound.bound_worker import ClimbBoundWorker, gap
from crux_planner.certificates.bound.climb import lower_bound
from crux_planner.certificates.bound.excursion import body_range, excursion, yaw_range
from crux_planner.certificates.bound.grasps import by_faces, grasps
from crux_planner.certificates.bound.multipliers import KnotQp, Multipliers
from crux_planner.certificates.bound.places import body_boxes, orientations
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.schedule import Swinging
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.solvers.worker import Worker
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.consensus import Scales
from crux_planner.trajectory.knot_qp import solve_knots
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scenes import scene, wall
from shared_plans import unproven
from simple_plans import staying_and_stepping, without_margin


@given(goal_m=st.floats(0.0, 0.06), slope=st.floats(20.0, 60.0), shift=st.floats(-0.02, 0.02))
@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.generate])
def test_no_plan_costs_less(goal_m: float, slope: float, shift: float) -> None:
    text = wall(20, goal_m=goal_m).replace("slope_deg: 45", f"slope_deg: {slope}")
    text = text.replace("LF-high, position_m: [0.29, 0.36]", f"LF-high, position_m: [{0.29 + shift}, {0.36 - shift}]")
    problem = build_problem(parse_scenario(text), load_robot("scaler"))
    costs = staying_and_stepping(problem)
    if costs:
        bound = lower_bound(problem, 1.1 * min(costs), 1.0)
        assert bound is not None
        assert bound <= min(costs)


def test_it_meets_the_best_of_all_plans_with_one_swing() -> None:
    """A wall where one limb has one hold to go to: every lift-off and touch-down there is, each at its cheapest."""
    lines = [line for line in wall(10, goal_m=0.01).splitlines() if "-high" not in line or "LF-high" in line]
    text = "\n".join(lines).replace("[0.29, 0.36]", "[0.22, 0.36]")
    text = text.replace("goal: {body", "goal: {grasps: {LF: {hold: LF-high, faces: x}}, body")
    problem = without_margin(build_problem(parse_scenario(text), load_robot("scaler")))
    equilibrium, windows = (
        StaticEquilibrium(problem, problem.friction_share),
        Windows(problem, ReachableSet(problem), SwingCache(problem)),
    )
    before = problem.start_contacts[0]
    after = next(c for c in windows.goals[0] if problem.contacts[c].pair == 0)
    path = np.linspace(problem.start.position_m, problem.goal.body.position_m, problem.steps + 1)
    costs = []
    for first in range(1, problem.steps):
        for end in range(first + windows.swings.intervals(before, after), problem.steps):
            schedule = windows.schedule([Swinging(0, first, end, before, after)])
            plan = solve_knots(problem, equilibrium, schedule, 0.0, None, Scales(), path, True)
            costs += [plan.cost] if plan is not None else []
    assert len(costs) > 5
    bound = lower_bound(problem, 1.2 * min(costs))
    assert bound is not None
    assert 0.8 * min(costs) <= bound <= min(costs)  # reach and limbs' mass are from outside: 0.813


@pytest.mark.parametrize("seed", [3, pytest.param(11, marks=pytest.mark.sweep)])
def test_no_plan_that_auto_finds_costs_less(seed: int) -> None:
    """Holds and goal of the four-hold wall moved about, planned, and bounded with nothing left out below 1.1 J."""
    random = np.random.default_rng(seed)
    text = wall(30, goal_m=0.1).replace("slope_deg: 45", f"slope_deg: {random.uniform(20, 90):.1f}")
    for name, (x, y) in {"LF-high": (0.29, 0.36), "RR-high": (0.01, -0.36), "RF-high": (0.29, -0.36)}.items():
        moved = f"{name}, position_m: [{x + random.uniform(-0.03, 0.0):.3f}, {y + random.uniform(-0.02, 0.02):.3f}]"
        text = text.replace(f"{name}, position_m: [{x}, {y}]", moved + f", yaw_deg: {random.uniform(-15, 15):.1f}")
    scenario, robot = parse_scenario(text), load_robot("scaler")
    result = unproven(scenario, robot)
    assert result.cost is not None
    bound = lower_bound(replace(build_problem(scenario, robot), steps=result.steps), 1.1 * result.cost)
    assert bound is not None
    assert 0.8 * result.cost <= bound <= result.cost


def test_every_wall_has_one_the_same_every_time() -> None:
    """A wall of 40 holds, too many for sets of single grasps; little work."""
    lines = wall(60, goal_m=0.6).splitlines()
    at = lines.index("holds:") + 9
    more = [
        f"  - {{name: more-{i}-{j}, position_m: [{0.45 + 0.16 * i}, {y}], size_m: [0.06, 0.06, 0.06], friction: 2.2}}"
        for i in range(8)
        for j, y in enumerate((0.44, 0.28, -0.28, -0.44))
    ]
    problem = build_problem(parse_scenario("\n".join(lines[:at] + more + lines[at:])), load_robot("scaler"))
    bounds = {lower_bound(problem, 60.0, effort=0.1) for _ in range(2)}
    assert len(bounds) == 1
    bound = bounds.pop()
    assert bound is not None
    assert bound > 0.11 * 60 + 0.3  # the weight shared evenly, and the way from 0.6 m off at full speed


def test_it_is_tight_where_nothing_moves() -> None:
    """Nothing to do for 20 knots but to stand: all that is left of J is where the body stands and how it is held."""
    problem = without_margin(scene(20, goal_m=0.0).problem)
    cheapest = min(staying_and_stepping(problem))
    bound = lower_bound(problem, 1.05 * cheapest, 5.0)
    assert bound is not None
    assert 0.77 * cheapest <= bound <= cheapest  # reach and limbs' mass are from outside: 0.777


def test_prices_never_ask_more_than_a_plan_pays() -> None:
    """Weak duality with multipliers out of the blue: a knot of a plan costs no less."""
    problem = scene(20, goal_m=0.0).problem
    slack = body_range(problem, 5.0)
    about = orientations(problem, *yaw_range(problem, 5.0))
    nodes = grasps(problem, about, *slack, by_faces(problem))
    assert nodes is not None
    multipliers, start = Multipliers(problem, about, nodes), [0, 0, 0, 0]
    node = np.flatnonzero((nodes.options == start).all(axis=1))
    qp = KnotQp(multipliers)
    good = qp.multipliers(dict(enumerate(problem.start_contacts)), slack)
    best = multipliers.values(good, node)[0]
    random = np.random.default_rng(0)
    for size in (0.01, 0.1, 1.0):
        other = good + size * np.abs(good).max() * random.normal(size=6)
        assert multipliers.values(other, node)[0] <= best + 1e-3
    assert best > 0.1


def test_boxes_hold_every_body_that_reaches_the_grasp() -> None:
    problem = scene(20).problem
    about = orientations(problem, -0.5, 0.5)
    low, high = body_boxes(problem, about)
    random = np.random.default_rng(1)
    boxes, tilt = problem.boxes, problem.body.max_tilt_rad
    for _ in range(300):
        limb, c = int(random.integers(4)), int(random.integers(len(problem.contacts)))
        rpy = random.uniform([-tilt, -tilt, -0.5], [tilt, tilt, 0.5])
        u = boxes.centre_b_m[limb] + boxes.half_m * random.choice([-1.0, 1.0, 0.3], 3)
        r = problem.contacts[c].centre_h_m - rotation_from_rpy(rpy) @ u
        if not problem.body.height_m[0] <= r[2] <= problem.body.height_m[1]:
            continue
        cell = int(np.searchsorted(about.yaw_high, rpy[2]))
        shift = np.array([about.shift_m[-1], about.shift_m[-1], 0.0])
        assert (low[limb, c, cell] - shift <= r + 1e-12).all()
        assert (r <= high[limb, c, cell] + shift + 1e-12).all()


def test_an_excursion_costs_no_more_than_the_quickest_one() -> None:
    """There and back at full speed, from the start to the goal 0."""
    step, start, far = 0.04, 0.1, 0.33
    there = np.arange(start, far, step)
    back = np.arange(far, 0.0, -step)
    assert float(excursion(np.array(far), step, start)) <= float((there[1:] ** 2).sum() + (back**2).sum()) + 1e-12
    assert float(excursion(np.array(far), step, start)) > 1.5 * far**2


def test_more_friction_never_raises_it() -> None:
    problem = scene(20, goal_m=0.0).problem
    values = []
    for friction in (3.0, 2.2, 0.6):
        rough = replace(problem, contacts=[replace(c, friction=np.full(2, friction)) for c in problem.contacts])
        values.append(lower_bound(rough, 3.0, 2.0))
    assert None not in values
    assert values[0] <= values[1] * 1.01 <= values[2] * 1.02  # type: ignore[operator]


def test_beside_says_what_is_proven_so_far() -> None:
    problem = scene(20, goal_m=0.0).problem
    with Worker() as worker:
        beside = ClimbBoundWorker(worker, problem, 3.0)
        beside.start_with(20, 5.0)
        found = beside.gap(5.0)
        assert found is not None
        assert 0.0 <= found < 0.3
        beside.start_with(20, 5.0)
        beside.start_with(21, 5.0)  # about other plans: begun anew
        beside.stop()
        assert not worker.waiting
        assert beside.gap(5.0) is None


def test_what_is_not_begun_is_worked_out_here() -> None:
    problem = scene(20, goal_m=0.0).problem
    with Worker(at_once=False) as worker:
        beside = ClimbBoundWorker(worker, problem)
        here = beside.gap_of(20, 5.0)
        assert worker.pid is None
        beside.get_ready()
        assert beside.gap_of(20, 5.0) == here
        assert worker.pid is not None
    assert here is not None


def test_a_gap_is_a_share_of_the_cost_or_nothing() -> None:
    assert gap(10.0, 9.0) == pytest.approx(0.1)
    assert gap(10.0, None) is None
    assert gap(10.0, -np.inf) is None


def test_the_papers_surface_has_no_bound() -> None:
    problem: Any = replace(scene(20, goal_m=0.0).problem, limit_surface="paper")
    assert lower_bound(problem) is None


def test_boxes_hold_every_body_whose_limbs_are_no_longer_than_stretched() -> None:
    """Bodies of which a limb is stretched, and no ends of boxes that are farther than that from a hold."""
    problem, random = scene(20).problem, np.random.default_rng(5)
    problem = replace(problem, boxes=problem.limb_reach.outer)
    about = orientations(problem, -0.5, 0.5)
    nodes = grasps(problem, about, np.array([-1.0, -1.0, 0.165]), np.array([1.0, 1.0, 0.21]), by_faces(problem))
    assert nodes is not None
    (level,) = np.flatnonzero((about.yaw_low <= 0.0) & (about.yaw_high > 0.0))
    of_level = np.flatnonzero((nodes.cell == level) & (nodes.in_air[nodes.node] < 3))
    centres, half = problem.boxes.centre_b_m[:, :2], problem.boxes.half_m[:2]
    limbs = [masses.limb for masses in problem.limb_masses]
    shoulders = np.array([limb.shoulder_b_m[:2] for limb in limbs])
    length = limbs[0].upper_link_m + limbs[0].lower_link_m
    tried, farthest = 0, 0.0
    for pair in random.choice(of_level, 4000).tolist():
        held = nodes.held(int(nodes.node[pair]))
        on, places = list(held), np.array([problem.contacts[c].centre_h_m[:2] for c in held.values()])
        low, high = nodes.low[pair, :2], nodes.high[pair, :2]
        angle, one = random.uniform(0.0, 2 * np.pi), int(random.integers(len(on)))
        r = places[one] - shoulders[on[one]] - 0.9999 * length * np.array([np.cos(angle), np.sin(angle)])
        fits = (np.abs(places - r - centres[on]) <= half).all()
        if fits and (np.linalg.norm(places - r - shoulders[on], axis=1) <= length).all():
            tried += 1
            assert (low - about.shift_m[0] <= r).all()
            assert (r <= high + about.shift_m[0]).all()
        for at in (low[1], high[1]):
            x = np.clip(places[-1, 0] - shoulders[on[-1], 0], low[0], high[0])
            farthest = max(farthest, float(np.linalg.norm(places[-1] - shoulders[on[-1]] - [x, at])))
    assert tried > 20
    assert farthest < 1.2 * length
