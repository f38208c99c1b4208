"""`planner.weights`, `planner.margins` and `planner.time_limit_s` of a scenario: each changes the plan as it says."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError, load_scenario
from crux_planner.checker import CheckReport, JointLoad, Violation
from crux_planner.errors import InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.model.walk_problem import build_walk
from crux_planner.physics.bounds import reach_bounds
from crux_planner.pipeline import climb
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.refusals import eased, nearer
from crux_planner.solvers import clock
from shared_plans import SharedPlans, unproven
from walls import one_move, scenario, two_rows

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"


def with_settings(robot: Robot, slope_deg: float = 45.0, **settings: Any) -> PlanResult:
    content = one_move(slope_deg=slope_deg)
    content["planner"] = {"idle": "keep", **settings}  # as many steps with all weights
    result = unproven(scenario(content), robot)
    assert result.check.ok
    return result


@pytest.fixture(scope="module")
def usual(robot: Robot) -> PlanResult:
    return with_settings(robot)


def body_error(result: PlanResult) -> float:
    """Sum of |r - r_goal|^2 [m^2]."""
    body = np.array([knot.body_position_w_m for knot in result.plan.knots])
    return float(((body - one_move()["goal"]["body"]["position_m"]) ** 2).sum())


def effort(result: PlanResult) -> float:
    """Sum of the fingers' squared forces [N^2]."""
    return float(sum(np.square(foot.finger_force_w_n).sum() for knot in result.plan.knots[:-1] for foot in knot.limbs))


def highest_m(result: PlanResult) -> float:
    return float(max(foot.gripper_position_w_m[2] for knot in result.plan.knots for foot in knot.limbs))


def test_a_heavy_body_weight_brings_the_body_to_the_goal_sooner(robot: Robot, usual: PlanResult) -> None:
    assert body_error(with_settings(robot, weights={"body": 100.0})) < 0.9 * body_error(usual)


def test_a_heavy_wrench_weight_spares_the_fingers(robot: Robot, usual: PlanResult) -> None:
    assert effort(with_settings(robot, weights={"wrench": 1e-3})) < effort(usual)


def test_the_switching_weight_counts_every_change_of_contact(robot: Robot, usual: PlanResult) -> None:
    dearer = with_settings(robot, weights={"switching": 1.3})
    changes = 2 * len(usual.gait)
    assert len(dearer.gait) == len(usual.gait)
    assert dearer.cost - usual.cost == pytest.approx(1.0 * changes, abs=0.05)


def test_the_friction_margin_leaves_more_of_the_limit_surface(robot: Robot, usual: PlanResult) -> None:
    careful = with_settings(robot, margins={"friction": 0.3})
    margins_N = [each.check.friction_margin_N or 0.0 for each in (careful, usual)]
    assert margins_N[0] > 1.3 * margins_N[1] > 0
    assert effort(careful) > effort(usual)


def test_the_clearance_margin_lifts_swings_higher(robot: Robot, usual: PlanResult) -> None:
    assert highest_m(with_settings(robot, margins={"clearance_m": 0.034})) > highest_m(usual) + 0.008


def test_the_torque_margin_bounds_the_joints(robot: Robot) -> None:
    content = two_rows()
    content["planner"] = {"margins": {"torque": 0.5}}
    full = np.stack([limb.effort_Nm for limb in robot.limbs])
    np.testing.assert_allclose(build_problem(scenario(content), robot).torque_limits_Nm, 0.5 * full)


def test_the_torque_margin_holds_between_the_knots_too(robot: Robot) -> None:
    content = one_move() | {"planner": {"margins": {"torque": 0.55}}}
    result = unproven(scenario(content), robot)
    assert result.check.ok
    shares = [joint.peak_torque_Nm / joint.effort_limit_Nm for joint in result.check.joints]
    assert 0.43 < max(shares) < 0.4545  # it binds, and between the knots a load may be a hundredth above them


def test_a_joint_that_the_check_finds_too_weak_gives_less_in_the_next_attempt(
    weak_robot: Callable[[Callable[[str, float], float]], Robot],
) -> None:
    """Without a margin, motors of 60 % are asked for more between the knots and as the controller shares the load."""
    lines: list[str] = []
    content = one_move(slope_deg=70.0) | {"planner": {"margins": {"torque": 0.0}}}
    result = unproven(scenario(content), weak_robot(lambda _, full_Nm: 0.6 * full_Nm), log=lines.append)
    assert result.check.ok
    said = re.compile(r"joint_torque\w* of \w\w at \d+\.\d s by 0\.\d* N m \w\w_joint\d; once more with less")
    assert any(said.search(line) for line in lines)


def test_only_the_joints_that_lack_torque_are_eased_and_none_that_has_nothing_to_give(robot: Robot) -> None:
    problem = build_problem(scenario(two_rows()), robot)
    full = problem.torque_limits_Nm
    loads = [JointLoad("RF", f"RF_joint{j}", 5.0, 1.0, 6.0, 1.0, 0.0, 1.0) for j in range(1, 7)]

    def lacking(amount: float, constraint: str = "joint_torque_shared") -> CheckReport:
        said = Violation(constraint, "RF", None, 4.0, amount, "N m", "RF_joint2", joint=1)
        return CheckReport(violations=[said], joints=loads)

    less = eased(problem, lacking(0.4))
    assert less is not None
    for limits, before in ((less.torque_limits_Nm, full), (less.last_torques_Nm, problem.last_torques_Nm)):
        assert before[1, 1] > limits[1, 1] == pytest.approx(5.0 - 1.5 * 0.4)
        assert (limits == before).sum() == limits.size - 1
    assert eased(problem, lacking(4.0)) is None
    assert eased(problem, lacking(0.4, "clearance_link")) is None


def test_limbs_keep_to_their_boxes_on_the_supports_that_the_check_names(robot: Robot) -> None:
    problem = build_problem(scenario(two_rows()), robot)
    contacts: list[list[int | None]] = [[0, 1, 2, 3], [None, 1, 2, 3], [4, 1, 2, 3]]
    said = Violation("joint_position", "RF", None, 1.5 * problem.dt_s, 0.1, "rad", "RF_joint3")
    report = CheckReport(violations=[said])
    assert nearer(problem, report, contacts) is None  # they do anyway
    far = problem.farther()
    mended = nearer(far, report, contacts)
    assert mended is not None
    assert mended.near == {tuple(contacts[1]), tuple(contacts[2])}
    assert nearer(mended, report, contacts) is None
    poses = np.zeros((3, 4, 5))
    poses[:, :, :3] = problem.start.position_m + problem.boxes.centre_b_m
    schedule = Schedule([], contacts, poses)
    bounds = [reach_bounds(replace(each, steps=2), schedule) for each in (far, mended)]
    size = [(high - low).reshape(2, 4, -1)[:, :, :2] for low, high in bounds]
    assert (size[1] < size[0] - 0.01).any(axis=2).all()
    np.testing.assert_allclose(size[1][1], 2 * np.tile(problem.boxes.half_m[:2], (4, 1)))


@pytest.mark.sweep
def test_the_body_leans_farther_than_boxes_let_it_where_that_is_cheaper(
    robot: Robot, planned: SharedPlans, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall = load_scenario(SCENES / "climb-obstacles.yaml")
    leaning = planned(wall, robot)
    monkeypatch.setattr(Problem, "farther", lambda problem: problem)
    kept = unproven(wall, robot)
    assert leaning.check.ok
    assert leaning.steps == kept.steps
    assert leaning.cost < 0.97 * kept.cost


def test_the_time_limit_leaves_time_for_the_check(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    deadlines: list[float] = []

    def level(*given: Any) -> PlanResult:
        deadlines.append(given[0].session.deadline)
        raise InfeasibleError("time limit", "as made up")

    monkeypatch.setattr(climb, "_plan_level", level)
    monkeypatch.setattr(climb, "plan_by_map", lambda *_, **__: None)
    content = two_rows()
    content["planner"] = {"time_limit_s": 4.0}
    wall, began = scenario(content), clock.now()
    with pytest.raises(InfeasibleError, match="as made up"):
        unproven(wall, robot)
    assert len(deadlines) == 1
    assert deadlines[0] - began < 4.0 - 0.8 + 0.1


@pytest.mark.parametrize(
    ("build", "scene", "right"),
    [(build_problem, "walk-flat", "point: expected patch"), (build_walk, "climb-one-step", "patch: expected point")],
)
def test_walks_and_climbs_are_not_taken_for_each_other(
    robot: Robot, build: Callable[..., object], scene: str, right: str
) -> None:
    with pytest.raises(ScenarioError, match=f"contact.model: {right}"):
        build(load_scenario(SCENES / f"{scene}.yaml"), robot)
