"""What keeps feet on the ground and joints within their speeds; gaits solved by two processes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.checker.report import CheckReport, Violation
from crux_planner.model.gait import Gait, Step, WalkMotion
from crux_planner.model.walk_problem import build_walk
from crux_planner.pipeline.refusals import bent
from crux_planner.search.gait_search import FlatSearch
from crux_planner.solvers.worker import Worker

FLAT = (Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "walk-flat.yaml").read_text()
PROBLEM = build_walk(parse_scenario(FLAT), load_robot("scaler"))


def test_masses_press_where_a_pendulum_has_its_foot() -> None:
    """Over its centre of pressure a pendulum falls: x'' = (x - p) g / h. From p = 0 it moves by cosh."""
    omega = 1.0 / np.sqrt(PROBLEM.pendulum_s2)
    places = 0.01 * np.cosh(omega * np.arange(8) * PROBLEM.dt_s)
    discrete = 2 * (np.cosh(omega * PROBLEM.dt_s) - 1) / (omega * PROBLEM.dt_s) ** 2  # of the second difference
    assert PROBLEM.pressing(places)[1:-1] / places[1:-1] == pytest.approx(np.full(6, 1 - discrete))
    assert PROBLEM.pendulum_s2 == pytest.approx(0.185 / 9.81, rel=1e-3)


def test_three_feet_keep_their_load_while_the_limbs_are_thrown() -> None:
    """Shares of the weight on three feet at both ends of every interval, from the positions of a plan in the plane."""
    problem = replace(PROBLEM, profile=replace(PROBLEM.profile, true_share=0.11))
    walk = FlatSearch(problem).begin(np.inf)
    feet, s = walk.gait.blend @ walk.footholds, problem.limbs_share
    centre = (1 - 4 * s) * walk.body[:, :2] + s * (feet - problem.neutral_feet_b_m).sum(axis=1)
    pressure = centre.copy()
    pressure[1:-1] -= problem.pendulum_s2 * np.diff(centre, 2, axis=0) / problem.dt_s**2
    least = np.inf
    for k in np.flatnonzero(walk.gait.stance[: problem.steps].sum(axis=1) == 3):
        corners = np.vstack([feet[k, walk.gait.stance[k]].T, np.ones(3)])
        for point in pressure[k : k + 2]:
            least = min(least, float(np.linalg.solve(corners, np.append(point, 1.0)).min()))
    assert least == pytest.approx(0.11, abs=0.01)  # less what footholds near those assumed change


def test_a_limb_asked_for_more_than_it_reaches_is_stretched() -> None:
    """The centre of mass of motions that programs begin with: a number, and the same however far beyond reach."""
    pose, yaws = np.array([[*PROBLEM.start.position_m, 0.0, 0.0, 0.0]]), np.zeros((1, 4))
    shoulder = PROBLEM.limb_masses[0].limb.shoulder_b_m
    places = []
    for times in (3.0, 6.0):
        feet = np.concatenate([PROBLEM.start_feet_h_m, np.zeros((4, 1))], axis=1)[None]
        wrist = pose[0, :3] + shoulder + times * np.array([0.2, 0.3, -0.1])
        feet[0, 0] = wrist - [0.0, 0.0, PROBLEM.limb_masses[0].limb.wrist_to_gripper_m + PROBLEM.pad_radius_m]
        places.append(PROBLEM.centres_of_mass(pose, feet, yaws))
    assert places[0] == pytest.approx(places[1])
    assert np.isfinite(places[0]).all()


def _report(time_s: float) -> CheckReport:
    return CheckReport(violations=[Violation("joint_speed", LIMB_NAMES[2], None, time_s, 1.0, "rad/s")])


@pytest.mark.parametrize(("share", "is_cut"), [((-0.95, 0.9, 0.1), True), ((-0.4, 0.3, 0.1), False)])
def test_the_corner_where_joints_are_too_fast_is_left_out(share: tuple[float, float, float], is_cut: bool) -> None:
    place = PROBLEM.boxes.centre_b_m[2] + np.array(share) * PROBLEM.boxes.half_m
    gait = Gait((Step(0, 2, 6),), np.ones(1), PROBLEM.steps + 1)
    body = np.zeros((PROBLEM.steps + 1, 12))
    foot = np.append(PROBLEM.start_feet_h_m[2], 0.0)
    body[:, :3] = foot - place
    solution: Any = WalkMotion(gait, body, np.zeros(0), np.vstack([PROBLEM.start_feet_h_m, [0.2, 0.3]]))
    less = bent(PROBLEM, solution, _report(1.0))
    assert (less is not None) == is_cut
    if less is not None:
        (cut,) = less.cuts
        assert cut.limb == 2
        assert cut.normal_b @ place > cut.most
        assert cut.normal_b @ PROBLEM.boxes.centre_b_m[2] < cut.most


def test_a_gait_solved_beside_another_is_the_same() -> None:
    with Worker() as beside:
        one, two = FlatSearch(PROBLEM), FlatSearch(PROBLEM, [beside])
        deadline = np.inf
        found = [search.improve(search.begin(deadline), 8, deadline) for search in (one, two)]
        assert beside.process is not None
    assert one.asked == two.asked
    assert found[0].gait.steps == found[1].gait.steps
    assert found[0].cost == found[1].cost
