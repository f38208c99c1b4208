"""Plans with all of what the limbs reach, on walls that no convex piece of it climbs."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.robot_bounds import JOINTS
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_planner.checker import CheckReport, Violation
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Move, stance_after
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.pipeline import by_map
from crux_planner.pipeline.by_joints import _along_path, _answered
from crux_planner.pipeline.by_map import AIMS, COARSE, SEARCH_RAD, _ByMap, _turned
from crux_planner.pipeline.session import Session
from crux_planner.pipeline.solve_and_check import Climb
from crux_planner.reach.arm import reaches_of
from crux_planner.search.ends import aims
from crux_planner.search.footing import Footing
from crux_planner.search.map_search import MapSearch
from crux_planner.search.pose_masks import PoseMasks, grid_about
from crux_planner.solvers import clock
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.joint_limits import JointLimits, Moment
from crux_planner.trajectory.link_planes import OFF_M
from crux_simulation.benchmarks.random_fields import random_field
from crux_tools.paths import SCENARIOS
from shared_plans import unproven
from walls import scattered, scenario, two_rows


def test_what_is_missing_at_the_goal_is_of_the_pose_with_most_holds(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within the goal's tolerances, where none lets all four limbs hold."""
    problem = build_problem(scenario(two_rows()), robot)
    poses = {"no hold for LR": ["LR"], "no holds for RF and RR on which these are off each other": []}
    searches = [
        SimpleNamespace(problem=problem, goals=[], idle_at_goal=idle, missing_at_goal=lambda text=text: text)
        for text, idle in poses.items()
    ]
    monkeypatch.setattr(by_map, "_searches", lambda _climb: iter(searches))
    climb = cast(Climb, SimpleNamespace(problem=problem))
    assert (by_map.missing_at_goal(climb) or "").startswith("no holds for RF and RR on which")


def test_what_the_check_finds_is_answered_at_its_moment() -> None:
    """Looked at first; with more margin where it was looked at already, and near the path where that does not help."""
    limits = JointLimits.about(np.zeros((8, BODY_STATES)), 0.02)
    said = [
        Violation("joint_position", "RF", None, 3.0, 0.1, "rad", "any name", joint=4),
        Violation("inverse_kinematics", "LR", None, 9.0, 0.001, "m"),
        Violation("clearance_limbs", "LF", None, 5.0, 0.002, "m"),
        Violation("joint_torque_shared", "LF", None, 5.0, 0.4, "N m", joint=1),
    ]
    margins, pose = np.full((4, JOINTS), 0.02), np.ones(6)

    def seen(time_s: float) -> tuple[Moment, Array]:
        return Moment(int(time_s // 2), time_s % 2 / 2, np.zeros((4, 4)), margins, off=np.zeros(6)), pose

    def clear(pose: Array, _hands: Array) -> Array:
        return 2 * pose

    answer, others = _answered(limits, CheckReport(violations=said), seen, clear)
    assert others == said[3:]
    assert [(m.interval, m.share) for m in answer.moments] == [(1, 0.5), (4, 0.5), (2, 0.5)]
    assert all((m.margin_rad == 0.02).all() and m.apart_m == OFF_M for m in answer.moments)
    assert answer.moments[2].clear == pytest.approx(2 * pose)
    again, others = _answered(answer, CheckReport(violations=said), seen, clear)
    assert others == said[3:]
    more = [np.argwhere(m.margin_rad > 0.02).tolist() for m in again.moments]
    assert more == [[[1, 4]], [[2, 2]], []]
    assert again.moments[0].margin_rad[1, 4] > 0.12
    assert again.moments[2].apart_m > OFF_M + 0.002
    assert np.isinf(again.near_m).all()
    for _ in range(4):
        again, _ = _answered(again, CheckReport(violations=said), seen, clear)
    assert np.flatnonzero(np.isfinite(again.near_m)).tolist() == [0, 1, 2, 3, 4, 5]
    nowhere, others = _answered(limits, CheckReport(violations=said), seen, lambda _pose, _hands: None)
    assert others == said[2:]
    assert len(nowhere.moments) == 2


def test_what_follows_from_a_limb_out_of_reach_is_no_cause_of_its_own() -> None:
    limits = JointLimits.about(np.zeros((8, BODY_STATES)), 0.02)
    said = [
        Violation("inverse_kinematics_orientation", "LR", None, 9.0, 0.1, "rad"),
        Violation("moment_balance", None, None, 9.5, 0.2, "N m"),
        Violation("moment_balance", None, None, 13.0, 0.2, "N m"),
    ]

    def seen(time_s: float) -> tuple[Moment, Array]:
        return Moment(int(time_s // 2), time_s % 2 / 2, np.zeros((4, 4)), np.full((4, JOINTS), 0.02)), np.ones(6)

    answer, others = _answered(limits, CheckReport(violations=said), seen, lambda pose, _hands: pose)
    assert others == said[2:]
    assert [(m.interval, m.share) for m in answer.moments] == [(4, 0.5)]


def test_only_limbs_without_a_closed_form_keep_to_the_path_where_there_is_no_plan() -> None:
    limits = JointLimits.about(np.zeros((8, BODY_STATES)), 0.02)
    closed, other = (cast(Problem, SimpleNamespace(closed_form=form)) for form in (True, False))
    assert _along_path(closed, limits) is None
    near = _along_path(other, limits)
    assert near is not None
    assert np.isfinite(near.near_m).all()
    assert _along_path(other, near) is None


def test_a_goal_is_aimed_at_within_its_tolerances_where_its_middle_has_no_stance(robot: Robot) -> None:
    """Field 404, with grasps off the middle of their faces."""
    problem = build_problem(parse_scenario(random_field(404)), robot, off_centre=True).aimed()
    goals = [problem, *itertools.islice(aims(problem, reaches_of(robot, SEARCH_RAD)), AIMS)]
    stances = []
    for each in goals:
        grid, goal = grid_about(each, *COARSE), problem.goal
        masks = PoseMasks(each, robot, grid, SEARCH_RAD)
        stances.append(len(MapSearch(masks, Footing(each, grid), SwingCache(each)).goals))
        assert np.linalg.norm(each.goal.body.position_m - goal.body.position_m) < goal.tolerance_m
        assert np.abs(each.goal.body.rpy_rad - goal.body.rpy_rad).max() < goal.tolerance_rad
    assert stances[0] == 0
    assert max(stances) > 0


def test_a_grip_that_only_a_turned_body_has_is_looked_at(robot: Robot) -> None:
    """Field 509: RF ends on a grasp to which its gripper may turn under the heading of the goal, not of the start."""
    problem = build_problem(parse_scenario(random_field(509)), robot)
    grid = grid_about(problem, *COARSE)
    ends = [c for c in problem.limb_contacts[1] if problem.may_end(1, problem.contacts[c])]
    held = PoseMasks(problem, robot, grid, SEARCH_RAD).held_at_goal(1, ends)
    assert held
    assert not set(held) & set(ReachableSet(problem).usable[1])
    assert set(problem.start_contacts) <= {c for own in ReachableSet(problem).usable for c in own}


def test_a_body_whose_way_ends_without_a_move_is_given_more_time(robot: Robot) -> None:
    assert unproven(parse_scenario(random_field(558)), robot, time_limit_s=60.0).check.ok


def test_a_body_turns_where_it_stands(robot: Robot) -> None:
    """By 20°, which takes more knots than to go nowhere."""
    wall = two_rows(all_limbs=False)
    wall["goal"] = {"body": {"position_m": wall["start"]["body"]["position_m"], "rpy_deg": [0.0, 0.0, 20.0]}}
    result = unproven(scenario(wall), robot, time_limit_s=60.0)
    assert result.check.ok
    assert result.gait == []


def test_a_body_tilts_from_its_start_to_its_goal(robot: Robot) -> None:
    """No convex piece of the reach holds for all of these tilts."""
    wall = two_rows()
    wall["start"]["body"]["rpy_deg"], wall["goal"]["body"]["rpy_deg"] = [5.0, 0.0, 0.0], [-5.0, 4.0, 0.0]
    result = unproven(scenario(wall), robot, time_limit_s=60.0)
    assert result.check.ok
    first, last = (np.degrees(result.plan.knots[k].body_rpy_rad) for k in (0, -1))
    assert first == pytest.approx([5.0, 0.0, 0.0])
    assert last == pytest.approx([-5.0, 4.0, 0.0], abs=3.0)


@pytest.mark.sweep
@pytest.mark.parametrize("seed", [403, 404, 407, 409, 411, 418])
def test_a_field_is_climbed_with_grips_beyond_the_convex_reach(robot: Robot, seed: int) -> None:
    field = parse_scenario(random_field(seed))
    result = unproven(field, robot, time_limit_s=60.0)
    assert result.check.ok
    inner, beyond = build_problem(field, robot).limb_reach.inner, []
    for knot in result.plan.knots:
        turn = rotation_from_rpy(np.array(knot.body_rpy_rad))
        for limb, each in enumerate(knot.limbs):
            place = turn.T @ (np.array(each.gripper_position_w_m) - knot.body_position_w_m)
            beyond.append(float(inner.beyond(limb, place).max()))
    assert max(beyond) > 0.01


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (1, 2, 4, 5, 6))])
def test_holds_anywhere_are_climbed_for_far(robot: Robot, seed: int) -> None:
    result = unproven(scenario(scattered(seed)), robot, time_limit_s=60.0)
    assert result.check.ok
    assert result.plan.knots[-1].body_position_w_m[0] > 0.78


def test_moves_are_tried_in_a_horizon_that_hardly_takes_them(robot: Robot) -> None:
    parsed = scenario(two_rows())
    given = build_problem(parsed, robot)
    start, end = given.start_contacts, next(c for c in given.limb_contacts[0] if given.contacts[c].hold == 4)
    moves = [Move(start, stance_after(start, (0,), (end,)), (0,), *[given.start.position_m] * 2)]
    swings = SwingCache(given)
    away = SimpleNamespace(position_m=given.start.position_m, rpy_rad=given.start.rpy_rad)

    def tried(steps: int) -> list[int]:
        problem = SimpleNamespace(start=given.start, goal=SimpleNamespace(body=away), body=given.body, dt_s=given.dt_s)
        problem.steps = steps
        climb = SimpleNamespace(oracles=SimpleNamespace(swings=swings), session=SimpleNamespace(scenario=parsed))
        return [each.knots for each in _ByMap._evenly(SimpleNamespace(problem=problem, climb=climb), moves)]  # type: ignore[arg-type]

    least = swings.intervals(start[0], end) + 3
    assert [tried(steps) for steps in (least - 1, least, least + 1)] == [[], [least], [least + 1]]
    assert tried(least + 20) == [least + 2, least + 4, least + 8]


def test_a_move_too_heavy_for_the_motors_is_left_out_with_all_that_turns_grippers_alone(robot: Robot) -> None:
    problem = build_problem(parse_scenario(random_field(403)), robot, off_centre=True)
    start, contacts = problem.start_contacts, problem.contacts
    limb, end = 1, next(c for c in problem.limb_contacts[1] if contacts[c].hold != contacts[start[1]].hold)
    step = start, limb, stance_after(start, (limb,), (end,))
    found = _turned(problem, step)
    assert step in found
    for before, moved, after in found:
        assert moved == limb
        assert [a for i, a in enumerate(after) if i != limb] == [b for i, b in enumerate(before) if i != limb]
        for one, other in zip((*before, after[limb]), (*start, end), strict=True):
            np.testing.assert_allclose(contacts[one].centre_h_m, contacts[other].centre_h_m, atol=1e-4)
    ends = {after[limb] for _, _, after in found}
    same = [c for c, each in enumerate(contacts) if np.allclose(each.centre_h_m, contacts[end].centre_h_m, atol=1e-4)]
    assert ends == set(same)
    assert len(ends) < sum(each.hold == contacts[end].hold for each in contacts)  # not those off the middle


def test_time_that_motions_took_is_not_laid_to_the_search_of_contacts(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The contacts are found at once, and their motion fails when the time is over."""

    def fails(session: Session, *_: object) -> None:
        while not session.late:
            clock.now()

    monkeypatch.setattr("crux_planner.pipeline.by_map.solve_by_joints", fails)
    wall = load_scenario(SCENARIOS / "climb-four-holds.yaml")
    with pytest.raises(
        InfeasibleError, match=r"no motion for them in the time allowed \(sequences tried: 1\)"
    ) as refused:
        unproven(wall, robot, time_limit_s=3.0)
    assert refused.value.undecided
