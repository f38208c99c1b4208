"""What is named as the reason was tried: steps of a horizon, and what else is made easier."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario_types import SIZE_M
from crux_planner.errors import TIME_LIMIT, HorizonError, InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.pipeline import cause
from crux_planner.pipeline.explanation import explain
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.relaxations import Relaxation, relaxations
from crux_planner.pipeline.session import RefusedWay, Session, Work
from crux_planner.pipeline.solve_and_check import Climb, _in_steps
from crux_planner.search.stances import Oracles, SearchReport
from crux_planner.solvers import clock
from leaning import leaning
from walls import blocked, scenario, two_rows


@pytest.fixture
def climb(robot: Robot) -> Climb:
    """Of two rows, 40 steps."""
    wall = scenario(two_rows())
    work = Work(lambda _what, _share: None, lambda _line: None)
    session = Session(wall, robot, work, clock.now() + 60.0, 60.0, "auto")
    return Climb(session, Oracles.of(build_problem(wall, robot)))


def refused_below(steps: int, reason: InfeasibleError) -> RefusedWay:
    """A way that gives a plan in so many steps."""
    return RefusedWay(reason, lambda taken, _: object.__new__(PlanResult) if taken >= steps else reason)


@pytest.mark.parametrize(
    ("enough", "reason", "named"),
    [
        (52, HorizonError("needs 52", 52), 52),
        (60, HorizonError("needs 52", 52), 63),  # a fifth longer
        (45, InfeasibleError("limit_surface_between_knots", "slips"), 50),  # a quarter of the way from 40 to 80
    ],
)
def test_as_many_steps_are_named_as_gave_a_plan(climb: Climb, enough: int, reason: InfeasibleError, named: int) -> None:
    """Whatever the failure of the search that came last is about."""
    climb.work.refused.append(refused_below(enough, reason))
    said = cause.cause(climb, InfeasibleError("equilibrium", "no equilibrium"), lambda _: False)
    assert isinstance(said, HorizonError)
    assert (said.needed, said.relaxed and said.relaxed["amount"]) == (named, named)
    assert f"in 40 steps of 2 s, but one in {named}" in str(said)


def test_a_search_that_its_time_ended_names_the_horizon_where_that_was_tried(climb: Climb) -> None:
    climb.work.refused.append(refused_below(52, HorizonError("needs 52", 52)))
    said = cause.cause(climb, InfeasibleError(TIME_LIMIT, "no time"), lambda _: False)
    assert said.constraint == "horizon"


def test_a_way_whose_swing_was_given_up_since_is_not_tried(climb: Climb) -> None:
    moves = cause._way(climb)
    assert moves
    (limb,) = moves[0].limbs
    swing = moves[0].before[limb], moves[0].after[limb]
    while climb.oracles.swings.swing(*swing) is not None:
        climb.oracles.swings.forbid(*swing)
    climb.work.refused.append(RefusedWay(HorizonError("needs 52", 52), partial(_in_steps, climb, moves)))
    assert cause._enough_steps(climb) is None


def test_what_was_not_tried_or_did_not_help_is_not_named(climb: Climb, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cause, "_way", lambda _: None)
    monkeypatch.setattr(cause, "relaxations", lambda *_: [])
    short = HorizonError("needs 52", 52)
    climb.work.refused.append(refused_below(10_000, short))
    assert cause.cause(climb, short, lambda _: False).relaxed is None
    said = cause.cause(climb, InfeasibleError("torque", "the joints are too weak"), lambda _: False)
    assert (said.constraint, said.relaxed) == ("contacts", None)
    assert "the search ended: the joints are too weak" in str(said)


def test_a_joint_that_the_check_names_asks_for_stronger_motors(climb: Climb, monkeypatch: pytest.MonkeyPatch) -> None:
    """A way there is: what gives a plan is what counts. Friction would, too, but is no joint's."""
    monkeypatch.setattr(cause, "_way", lambda _: [])
    seen = []

    def planned(easier: Climb) -> bool:
        seen.append(easier.session.robot.limbs[0].joints[0].effort / climb.session.robot.limbs[0].joints[0].effort)
        return seen[-1] > 1.3 or seen[-1] == 1.0

    refused = InfeasibleError("joint_torque_shared", "every plan found fails the check: joint_torque_shared of LF")
    said = cause.cause(climb, refused, planned)
    assert seen == pytest.approx([1.1, 1.4])
    assert said.constraint == "torque"
    assert str(said) == f"{refused}; with 1.40 times the motor torque a plan is found"


@pytest.fixture
def easier(climb: Climb, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Relaxation]:
    """By constraint, the last."""
    return {each.constraint: each for each in relaxations(climb, "", tmp_path_factory.mktemp("robots"))}


def test_what_is_made_easier_is_so_for_planner_and_check_alike(climb: Climb, easier: dict[str, Relaxation]) -> None:
    from crux_planner.checker.limb_model import load_model

    stronger = easier["torque"].climb(climb, 10)
    for before, after in zip(
        load_model(climb.session.robot).limbs, load_model(stronger.session.robot).limbs, strict=True
    ):
        assert [j.effort for j in after.joints] == pytest.approx([1.5 * j.effort for j in before.joints])
    assert stronger.problem.torque_limits_Nm == pytest.approx(1.5 * climb.problem.torque_limits_Nm)
    rougher = easier["equilibrium"].climb(climb, 10)
    again = build_problem(rougher.session.scenario, climb.session.robot)
    for read, tried in zip(again.contacts, rougher.problem.contacts, strict=True):
        assert read.friction == pytest.approx(tried.friction)
        assert tried.friction.max() == pytest.approx(3.3)


def test_an_obstacle_of_either_version_is_made_smaller_where_it_stands(robot: Robot, tmp_path: Path) -> None:
    wall, work = leaning({"+x": 30, "-x": 30}), Work(lambda _what, _share: None, lambda _line: None)
    pose, size = {"position_m": [0.225, 0.6, 0.01], "rpy_deg": [0.0, -20.0, 5.0]}, [0.02, 0.2, 0.1]
    turned = scenario(wall | {"obstacles": [{"name": "slab", "pose": pose, "shape": {"box_m": size}}]})
    for read in (scenario(blocked(1.0)), turned):
        session = Session(read, robot, work, clock.now() + 60.0, 60.0, "auto")
        climb = Climb(session, Oracles.of(build_problem(read, robot)))
        passage = relaxations(climb, "passage", tmp_path)[0]
        (before,), (after,) = read.obstacles, passage.climb(climb, 10).session.scenario.obstacles
        assert after.size_m == pytest.approx([max(0.5 * edge, SIZE_M[0]) for edge in before.size_m])
        assert replace(after, size_m=before.size_m) == before


def test_a_limb_that_only_an_obstacle_stops_lacks_a_passage(robot: Robot) -> None:
    oracles = Oracles.of(build_problem(scenario(blocked(1.0)), robot))
    reason = explain(oracles, SearchReport(nearest=oracles.problem.start_contacts), 1)
    assert reason.constraint == "passage"
    assert "LF finds no chain of holds from LF-low to the goal: obstacles" in str(reason)
