"""The contact block: balance against a linear program, the search on small walls, schedules and body paths."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.errors import InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.mass import centres_of_mass, linear_centre
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule
from crux_planner.search.body_path import SPEED_SHARE, knot_path, smooth_events
from crux_planner.search.equilibrium import MOMENT_ARM_M, StaticEquilibrium
from crux_planner.search.schedule import least_durations, scheduled
from crux_planner.search.stances import Oracles, search
from crux_planner.solvers import clock
from crux_planner.swing.swing_cache import SwingCache
from crux_simulation.benchmarks.random_walls import random_ladder
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from walls import hold, ladder, scenario, two_rows


@lru_cache
def problem_of(slope_deg: float = 45.0, max_normal_N: float = 60.0, hanging: int = 0, unlike: int = 0) -> Problem:
    wall = two_rows(slope_deg=slope_deg)
    wall["contact"]["max_normal_N"] = max_normal_N
    if hanging:
        wall["contact"].update(spines_only={"LF": hanging, "RR": hanging}, spine_shear_N=20)
    random = np.random.default_rng(unlike)
    for part in wall["holds"] if unlike else []:
        part["friction"] = {face: float(random.uniform(0.0, 1.5)) for face in ("+x", "-x", "+y", "-y", "top")}
        part["spines"] = {face: bool(random.integers(2)) or hanging > 0 for face in ("+x", "-x", "+y", "-y", "top")}
    return build_problem(scenario(wall), load_robot("scaler"))


def moves_of(problem: Problem, at_once: int = 1) -> list[Move] | None:
    found, _ = search(Oracles.of(problem), at_once=at_once, greed=1.0, deadline=clock.now() + 60)
    return found


@pytest.mark.parametrize(
    "rungs", [8, 20, pytest.param(38, marks=pytest.mark.sweep), pytest.param(50, marks=pytest.mark.sweep)]
)
def test_a_route_is_found_by_looking_at_few_more_stances_than_it_has(rungs: int) -> None:
    """Walls of two holds a rung: most orders of the same moves are as quick, and not all of them are looked at."""
    problem = build_problem(parse_scenario(random_ladder(1, rungs, steps=18 * rungs)), load_robot("scaler"))
    moves, seen = search(Oracles.of(problem), at_once=1, greed=1.0, deadline=clock.now() + 600)
    assert moves is not None
    assert seen.expanded < 1.2 * len(moves) + 10


def balanced(problem: Problem, support: tuple[int, ...], position: np.ndarray, margin: float) -> bool:
    """Whether forces balance at a body position: a linear program over (s1, s2, m, n1, n2) of every gripper."""
    k, columns, rows, bounds = problem.patch.k_m, [], [], []
    grippers = np.mean([problem.contacts[c].centre_h_m for c in problem.start_contacts], axis=0)
    follow, rest = linear_centre(problem)
    centre = position + rest + follow @ (grippers - position)
    for i, index in enumerate(support):
        contact = problem.contacts[index]
        axis, tangent, up = contact.axis, contact.tangent, np.array([0, 0, 1.0])
        arm = contact.centre_h_m - centre
        for force, moment in (
            (2 * tangent, 0),
            (2 * up, 0),
            (np.zeros(3), 2 * axis),
            (axis, 0),
            (-axis, 0),
        ):
            columns.append(np.concatenate([force, np.cross(arm, force) + moment]))
        for finger in (3, 4):
            for g in np.ndindex(3, 3, 3):
                sign = np.array(g) - 1.0
                if not sign.any():
                    continue
                reach = 0.8 if np.abs(sign).sum() == 1 else 1.4
                row = np.zeros(5 * len(support))
                row[5 * i : 5 * i + 3] = sign / [1, 1, k]
                row[5 * i + finger] = -margin * reach * contact.friction[finger - 3]
                rows.append(row)
                spine = np.abs(sign) @ (contact.spines[finger - 3] / [1, 1, k])
                bounds.append(margin * spine)
    variable_bounds: list[tuple[float | None, float | None]] = []
    for index in support:
        most = [
            0.0 if problem.contacts[index].spines_only == f else margin * problem.patch.max_normal_N for f in (1, 2)
        ]
        variable_bounds += [(None, None)] * 3 + [(0, n) for n in most]
    result = linprog(
        np.zeros(5 * len(support)),
        A_ub=np.array(rows),
        b_ub=bounds,
        A_eq=np.array(columns).T,
        b_eq=np.concatenate([-problem.weight_N, np.zeros(3)]),
        bounds=variable_bounds,
    )
    return bool(result.status == 0)


@given(st.integers(0, 3), st.floats(-0.15, 0.15), st.floats(-0.15, 0.15), st.sampled_from([18.0, 30.0, 60.0]))
@settings(max_examples=40, deadline=None)
def test_balance_is_found_where_a_linear_program_finds_it(lifted: int, x: float, y: float, most_N: float) -> None:
    problem = problem_of(max_normal_N=most_N) if most_N >= 30 else problem_of(slope_deg=0.0, max_normal_N=most_N)
    support = tuple(c for limb, c in enumerate(problem.start_contacts) if limb != lifted)
    position = np.array([x, y, 0.185])
    found = StaticEquilibrium(problem, 0.9).position(support, position, position, position, problem.start_contacts)
    assert (found is not None) == balanced(problem, support, position, 0.9)


@given(
    st.integers(0, 4), st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.integers(1, 2), st.sampled_from([60.0, 75.0])
)
@settings(max_examples=40, deadline=None)
def test_balance_of_grippers_that_hang_by_spines(lifted: int, x: float, y: float, finger: int, slope: float) -> None:
    problem = problem_of(slope_deg=slope, hanging=finger)
    support = tuple(c for limb, c in enumerate(problem.start_contacts) if limb != lifted)
    assert [problem.contacts[c].spines_only for c in problem.start_contacts] == [finger, 0, 0, finger]
    position = np.array([x, y, 0.17])
    found = StaticEquilibrium(problem, 0.9).position(support, position, position, position, problem.start_contacts)
    assert (found is not None) == balanced(problem, support, position, 0.9)


@given(st.integers(1, 20), st.integers(0, 4), st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.integers(0, 2))
@settings(max_examples=60, deadline=None)
def test_balance_on_faces_of_which_each_has_its_own_friction(
    unlike: int, lifted: int, x: float, y: float, finger: int
) -> None:
    problem = problem_of(slope_deg=30.0, hanging=finger, unlike=unlike)
    support = tuple(c for limb, c in enumerate(problem.start_contacts) if limb != lifted)
    position = np.array([x, y, 0.17])
    found = StaticEquilibrium(problem, 0.9).position(support, position, position, position, problem.start_contacts)
    assert (found is not None) == balanced(problem, support, position, 0.9)


def test_the_centre_of_mass_follows_the_grippers_about_as_a_straight_line_says() -> None:
    """Against the closed-form kinematics anywhere in (9a); the body's origin is far more off."""
    problem = problem_of()
    random = np.random.default_rng(3)
    grippers = problem.boxes.centre_b_m + problem.boxes.half_m * random.uniform(-1.0, 1.0, (500, 4, 3))
    hands = np.concatenate([grippers, np.zeros((500, 4, 1))], axis=2)
    true = centres_of_mass(problem, np.zeros((500, 6)), hands)
    follow, rest = linear_centre(problem)
    off = np.linalg.norm(grippers.mean(axis=1) @ follow.T + rest - true, axis=1)
    assert off.max() < 0.008
    assert off.mean() < np.linalg.norm(true, axis=1).mean() / 5


def test_a_lack_of_force_is_told_in_newtons() -> None:
    problem = problem_of()
    equilibrium, here = StaticEquilibrium(problem, 1.0), problem.start.position_m
    assert equilibrium.missing_force(problem.start_contacts, here, here) < 1e-3
    weak = StaticEquilibrium(problem, 1e-4)  # grippers that carry nothing: all the weight is lacking, and its moment
    middle = np.mean([problem.contacts[c].centre_h_m for c in problem.start_contacts], axis=0)
    follow, rest = linear_centre(problem)
    moment = np.cross(here + rest + follow @ (middle - here) - middle, problem.weight_N) / MOMENT_ARM_M
    expected = float(np.linalg.norm([*problem.weight_N, *moment]))
    assert weak.missing_force(problem.start_contacts, here, here) == pytest.approx(expected, rel=0.01)


def test_the_search_moves_every_limb_once_and_ends_on_the_goals_grasps() -> None:
    problem = problem_of()
    moves = moves_of(problem)
    assert moves is not None
    assert sorted(limb for move in moves for limb in move.limbs) == [0, 1, 2, 3]
    ends = [problem.contacts[c] for c in moves[-1].after]
    assert {limb: (c.hold, c.pair) for limb, c in enumerate(ends)} == problem.goal.grasps
    for before, after in pairwise(moves):
        assert before.after == after.before


def test_two_limbs_at_once_take_no_more_moves_than_one() -> None:
    problem = problem_of(slope_deg=0.0)
    one, two = moves_of(problem), moves_of(problem, at_once=2)
    assert one is not None
    assert two is not None
    assert len(two) <= len(one)


def test_grippers_never_share_a_hold_nor_stand_where_their_palms_would_touch() -> None:
    problem = problem_of()
    swings, contacts = SwingCache(problem), problem.contacts
    along_x = [
        next(i for i, c in enumerate(contacts) if (c.hold, c.pair) == (h, 0)) for h in range(len(problem.hold_names))
    ]
    lf_low, lr_low, lf_high, lr_high = along_x[0], along_x[2], along_x[4], along_x[6]
    assert not swings.free([(lr_low, lf_low)], (lf_low,))
    assert contacts[lf_low].centre_h_m[0] - contacts[lr_high].centre_h_m[0] == pytest.approx(0.13)  # palms: 2 x 66 mm
    assert not swings.free([(lr_low, lr_high)], (lf_low,))
    assert swings.free([(lr_low, lr_high)], (lf_high,))


def laid_out(problem: Problem) -> tuple[Schedule, list[Move], StaticEquilibrium]:
    oracles = Oracles.of(problem)
    equilibrium, swings = oracles.equilibrium, oracles.swings
    moves = moves_of(problem)
    assert moves is not None
    moves = smooth_events(oracles, moves)
    return (
        scheduled(problem, swings, moves, SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s),
        moves,
        equilibrium,
    )


def test_a_schedule_fills_the_horizon_and_leaves_no_knot_with_two_limbs_in_the_air() -> None:
    problem = problem_of()
    schedule, moves, _ = laid_out(problem)
    assert len(schedule.contacts) == problem.steps + 1
    assert schedule.poses.shape == (problem.steps + 1, 4, 5)
    assert max(sum(c is None for c in knot) for knot in schedule.contacts) == 1
    assert tuple(schedule.contacts[0]) == problem.start_contacts
    assert tuple(schedule.contacts[-1]) == moves[-1].after
    for knot, poses in zip(schedule.contacts, schedule.poses, strict=True):
        for contact, pose in zip(knot, poses, strict=True):
            if contact is not None:
                np.testing.assert_array_equal(pose[:3], problem.contacts[contact].centre_h_m)


def test_the_body_travels_while_limbs_swing_and_not_in_stances_between() -> None:
    problem = build_problem(scenario(ladder(6)), load_robot("scaler"))
    oracles = Oracles.of(problem)
    swings = oracles.swings
    moves = moves_of(problem)
    assert moves is not None
    step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s

    def knots(sequence: list[Move]) -> int:
        return int(sum(part.sum() for part in least_durations(problem, swings, sequence, step)))

    smooth = smooth_events(oracles, moves)
    in_air = sum(swings.intervals(move.before[limb], move.after[limb]) for move in moves for limb in move.limbs)
    first_and_last = 1 + 2  # rest at the start; the body comes to rest before the last knot
    assert knots(smooth) < knots(moves)
    assert knots(smooth) <= in_air + len(moves) + 1 + first_and_last


def test_the_body_path_keeps_speed_reach_and_balance() -> None:
    problem = problem_of()
    schedule, _, equilibrium = laid_out(problem)
    path = knot_path(problem, equilibrium, schedule)
    assert path is not None
    np.testing.assert_allclose(path.positions[0], problem.start.position_m, atol=1e-6)
    np.testing.assert_allclose(path.positions[-1], problem.goal.body.position_m, atol=problem.goal.tolerance_m)
    steps = np.abs(np.diff(path.positions, axis=0)).max()
    assert steps <= problem.body.max_speed_m_s * problem.dt_s
    offsets = schedule.poses[..., :3] - path.positions[:, None] - problem.boxes.centre_b_m
    assert (np.abs(offsets) <= problem.boxes.half_m + 1e-6).all()
    for k, grips in enumerate(path.wrenches):
        total = sum(equilibrium.maps[schedule.contacts[k][limb]] @ w[:4] for limb, w in grips.items())
        right = equilibrium.right_side(path.positions[k], schedule.poses[k, :, :3].mean(axis=0))
        np.testing.assert_allclose(total, right, atol=1e-3)


def test_a_horizon_that_is_too_short_says_how_long_it_must_be(robot: Robot) -> None:
    problem = build_problem(scenario(two_rows(steps=10)), robot)
    moves = moves_of(problem)
    assert moves is not None
    with pytest.raises(InfeasibleError, match=r"needs (\d+) steps of 2 s, the horizon has 10") as error:
        scheduled(problem, SwingCache(problem), moves, 0.04)
    needed = int(str(error.value).split("needs ")[1].split(" ")[0])
    longer = build_problem(scenario(two_rows(steps=needed)), robot)
    scheduled(longer, SwingCache(longer), moves, 0.04)


def test_holds_too_near_to_open_between_cannot_be_gripped(robot: Robot) -> None:
    wall = two_rows()
    wall["holds"] += [hold("near", 0.29 + 0.09, 0.37)]  # 0.09 m from LF-high along its fingers
    wall["goal"]["grasps"].pop("LF")
    names = {
        (build.contacts[i].hold, build.contacts[i].pair)
        for build in [build_problem(scenario(wall), robot)]
        for i in range(len(build.contacts))
    }
    index = [h["name"] for h in wall["holds"]].index("LF-high")
    assert (index, 0) not in names
    assert (index, 1) in names
