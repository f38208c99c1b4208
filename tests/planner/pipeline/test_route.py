"""Routes in parts: each a checked plan that begins where the one before ends, of what stands near its way alone."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.plan_file import PlanFileError, write_plan
from crux_contracts.plan_route import misfit, part_path, read_route
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, ScenarioError, load_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.checker.cli import add_check_parser, run_check
from crux_planner.errors import InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.pipeline import route as route_module
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.replan import Planner
from crux_planner.pipeline.route import TOLERANCE_M, plan_route, reach_m
from walls import hold, ladder, scenario, text

from .test_plan_cli import crux_plan

SCENARIOS = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"


def wall() -> dict[str, Any]:
    long = ladder(11)
    long["obstacles"] = [
        {"name": "far", "position_m": [0.0, 3.0], "size_m": [0.1, 0.1, 0.1]},
        {"name": "near", "position_m": [0.5, 0.57], "size_m": [0.05, 0.05, 0.03]},
    ]
    return long


@pytest.fixture(scope="module")
def whole() -> Scenario:
    return scenario(wall())


@pytest.fixture(scope="module")
def parts(whole: Scenario, robot: Robot) -> list[PlanResult]:
    return list(plan_route(whole, robot))


def test_each_part_passes_the_check_and_begins_where_the_one_before_ends(parts: list[PlanResult], robot: Robot) -> None:
    assert len(parts) == 2
    assert all(check_plan(part.plan, robot).ok for part in parts)
    (first, second) = (part.plan for part in parts)
    assert misfit(first, second) == ""
    end, begin = first.knots[-1], second.knots[0]
    np.testing.assert_allclose(begin.body_position_w_m, end.body_position_w_m, atol=1e-9)
    for held, holds in zip(end.limbs, begin.limbs, strict=True):
        assert first.holds[held.hold].name == second.holds[holds.hold].name
        assert held.finger1_face == holds.finger1_face


def test_the_route_ends_at_its_goal(parts: list[PlanResult], whole: Scenario) -> None:
    ends = [part.plan.knots[-1].body_position_w_m for part in parts]
    goal = np.array(whole.goal.body.position_m)
    assert np.linalg.norm(ends[-1] - goal) <= whole.goal.tolerance_m
    assert abs(ends[0][0] - 0.42) <= TOLERANCE_M  # half of the usual way, so that it is there soon


def test_a_part_knows_what_it_can_reach(parts: list[PlanResult], whole: Scenario, robot: Robot) -> None:
    for part in parts:
        begin, end = (part.plan.knots[k].body_position_w_m[0] for k in (0, -1))
        for each in whole.holds:
            off_m = np.hypot(max(begin - each.position_m[0], each.position_m[0] - end, 0.0), each.position_m[1])
            known = each.name in [hold.name for hold in part.plan.holds]
            if abs(off_m - reach_m(robot)) > 0.1:
                assert known == (off_m < reach_m(robot)), each.name
        names = [each.name for each in part.plan.holds]
        assert "near" in names
        assert "far" not in names


def test_a_gripper_off_the_middle_of_its_face_is_no_start_of_a_part(
    parts: list[PlanResult], whole: Scenario, robot: Robot
) -> None:
    """A scenario's start names hold and faces alone."""
    route = route_module._Route(whole, robot)
    assert route.goes_on(parts[0])
    off = replace(parts[0], plan=plan_t.decode(parts[0].plan.encode()))
    x, y, z = off.plan.knots[-1].limbs[3].gripper_position_w_m
    off.plan.knots[-1].limbs[3].gripper_position_w_m = [x, y + 0.005, z]
    assert not route.goes_on(off)


def test_a_part_of_another_format_is_none_of_the_route(
    parts: list[PlanResult], whole: Scenario, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The runtime would refuse it, and the robot stop there."""
    found = iter([parts[0], *[of_format(parts[1], plan_t.FORMAT_OWN_TIMES)] * len(route_module.GOALS)])
    monkeypatch.setattr(Planner, "plan", lambda _self, **_options: next(found))
    monkeypatch.setattr(route_module, "GOALS", route_module.GOALS[:2])
    monkeypatch.setattr(route_module, "THOROUGH", 0)
    route = plan_route(whole, robot)
    assert next(route) is parts[0]
    with pytest.raises(InfeasibleError, match="has the format of those before"):
        next(route)


def of_format(result: PlanResult, plan_format: int) -> PlanResult:
    other = plan_t.decode(result.plan.encode())
    other.format = plan_format
    return replace(result, plan=other)


def test_where_the_holds_end_the_parts_before_are_there(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(route_module, "GOALS", route_module.GOALS[:2])
    monkeypatch.setattr(route_module, "THOROUGH", 0)
    broken = wall()
    broken["holds"] = [each for each in broken["holds"] if each["position_m"][0] < 0.7]
    route = plan_route(scenario(broken), robot, time_limit_s=5.0)
    assert next(route).ok
    with pytest.raises(InfeasibleError, match=r"no part of the route from the body at \(0\.4"):
        next(route)


def test_walks_are_no_routes(robot: Robot) -> None:
    with pytest.raises(ScenarioError, match=r"contact\.model"):
        next(plan_route(load_scenario(SCENARIOS / "walk-flat.yaml"), robot))


def test_what_is_too_much_for_one_plan_says_so(robot: Robot) -> None:
    many = wall()
    many["holds"] += [hold(f"more-{i}", 2.0 + 0.1 * (i // 20), 2.0 + 0.1 * (i % 20)) for i in range(300)]
    with pytest.raises(ScenarioError, match=r"holds.*at most 300 .*--stream"):
        build_problem(scenario(many), robot)
    far = wall()
    far["goal"]["body"]["position_m"] = [60.0, 0.0, 0.185]
    with pytest.raises(ScenarioError, match=r"goal\.body.*60\.0 m away.*--stream"):
        build_problem(scenario(far), robot)


def write(folder: Path, plans: list[plan_t]) -> None:
    for number, plan in enumerate(plans):
        write_plan(part_path(folder, number), plan)


def test_a_folder_of_parts_is_read_in_order(parts: list[PlanResult], tmp_path: Path) -> None:
    with pytest.raises(PlanFileError, match=r"no 00000\.mcap in it"):
        list(read_route(tmp_path))
    write(tmp_path, [part.plan for part in parts])
    assert [path.name for path, _ in read_route(tmp_path)] == ["00000.mcap", "00001.mcap"]


@pytest.mark.parametrize("what", ["body", "gripper", "phase", "gravity", "format", "robot"])
def test_parts_that_do_not_join_are_refused(what: str, parts: list[PlanResult], tmp_path: Path) -> None:
    off = plan_t.decode(parts[1].plan.encode())
    knot = off.knots[0]
    if what == "body":
        knot.body_rpy_rad = [knot.body_rpy_rad[0] + 1e-4, *knot.body_rpy_rad[1:]]
    elif what == "gripper":
        x, y, z = knot.limbs[2].gripper_position_w_m
        knot.limbs[2].gripper_position_w_m = [x, y + 1e-4, z]
    elif what == "phase":
        knot.limbs[1].phase = knot.limbs[1].AIR
    elif what == "gravity":
        off.gravity_w_m_s2 = [0.0, 0.0, -9.81]
    elif what == "format":
        off.format = plan_t.FORMAT_OWN_TIMES
    else:
        off.robot_sha256 = "0" * 64
    write(tmp_path, [parts[0].plan, off])
    with pytest.raises(PlanFileError, match=r"00001\.mcap: does not go on from 00000\.mcap"):
        list(read_route(tmp_path))


def test_the_command_writes_parts_and_the_checker_reads_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "wall.yaml").write_text(text(ladder(4)))
    words = [str(tmp_path / "wall.yaml"), "-o", str(tmp_path / "route"), "--stream"]
    assert crux_plan(*words, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert [Path(part["plan"]).name for part in said["parts"]] == ["00000.mcap"]
    assert crux_plan(*words) == 2
    assert "has a route in it" in capsys.readouterr().err
    assert crux_plan(*words, "--prove", "1") == 2
    assert "--prove does not go with --stream" in capsys.readouterr().err
    parser = argparse.ArgumentParser()
    add_check_parser(parser.add_subparsers())
    assert run_check(parser.parse_args(["check", str(tmp_path / "route")])) == 0
