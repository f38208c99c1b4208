"""When there is no plan, the message names the constraint, the limb and the place."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import crux_planner
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError
from crux_planner.errors import InfeasibleError
from crux_planner.pipeline import by_map
from leaning import leaning
from shared_plans import unproven
from walls import FEET, blocked, hold, one_move, scenario, two_rows

Change = Callable[[dict[str, Any]], object]


def far_goal(wall: dict[str, Any]) -> None:
    wall["goal"] = {"body": {"position_m": [1.0, 0.0, 0.185]}}


def gap_in_the_holds(wall: dict[str, Any]) -> None:
    wall["holds"] += [hold(f"top-{x}-{y}", x, y) for x in (1.86, 2.14) for y in (0.36, -0.36)]
    wall["goal"] = {"body": {"position_m": [2.0, 0.0, 0.185]}}


def smooth_target_holds(wall: dict[str, Any]) -> None:
    wall.update(one_move())  # of few holds, so that the search ends by itself
    wall["contact"].update(spine_shear_N=0)
    for part in wall["holds"]:
        part["friction"] = 0.46


INFEASIBLE: dict[str, tuple[Change, str, str]] = {
    "goal out of reach": (
        far_goal,
        "reach",
        r"no hold within reach of LF .* \[1\.00, 0\.00, 0\.185\] m.* LF-high, is \d+ mm",
    ),
    "gap": (
        gap_in_the_holds,
        "reach",
        r"no hold for LF within the reach that crux plans with for a body between \[0\.\d+, .* and \[1\.\d+, ",
    ),
    "goal too high": (
        lambda wall: wall["goal"]["body"].update(position_m=[0.1, 0, 0.4]),
        "goal bounds",
        r"position_m\[2\].*0\.165\.\.0\.21 m",
    ),
    "goal tilted": (
        lambda wall: wall["goal"]["body"].update(rpy_deg=[0, 25, 0]),
        "goal bounds",
        r"rpy_deg.*11\.5 degrees",
    ),
    "goal grasp out of reach": (
        lambda wall: wall["goal"]["grasps"].update(
            RR={"hold": "LF-high", "faces": "x"}, LF={"hold": "RR-high", "faces": "x"}
        ),
        "reach",
        r"goal\.grasps\.LF: RR-high is out of reach .* \d+ mm outside LF's workspace",
    ),
    "friction too low to lift": (
        smooth_target_holds,
        "equilibrium",
        r"no equilibrium when \w\w lifts off .*short by \d+\.\d N",
    ),
}


LOOKS = 40  # at moves: a search for other headings ends sooner
LONG = {"gap"}  # certificates/test_proof.py proves the same gap


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=name, marks=[pytest.mark.sweep] * (name in LONG)) for name, case in INFEASIBLE.items()],
)
def test_what_cannot_be_done_says_why_and_where(
    robot: Robot, case: tuple[Change, str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(by_map, "LOOKS", LOOKS)
    change, constraint, message = case
    wall = two_rows()
    change(wall)
    with pytest.raises(InfeasibleError, match=message) as error:
        unproven(scenario(wall), robot)
    assert error.value.constraint == constraint
    if constraint in ("reach", "goal bounds"):
        assert error.value.proven


def test_weak_motors_are_named_with_the_torque_that_would_do(
    weak_robot: Callable[[Callable[[str, float], float]], Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the factor there is a plan, which the check passes for that robot."""
    monkeypatch.setattr(by_map, "LOOKS", LOOKS)
    steep = scenario(one_move(slope_deg=70.0))
    motor = r"motor torque a plan is found; without, .* goes to .*: \w\w_joint\d would need [\d.]+ N m, it has [36]"
    with pytest.raises(InfeasibleError, match=motor) as error:
        unproven(steep, weak_robot(lambda _, effort_Nm: 0.5 * effort_Nm))
    assert error.value.constraint == "torque"
    said: Any = error.value.to_json()["relaxed"]
    assert said["constraint"] == "torque"
    assert 1.1 < said["amount"] < 1.6
    enough = 0.5 * said["amount"]
    assert unproven(steep, weak_robot(lambda _, effort_Nm: enough * effort_Nm)).check.ok


@pytest.mark.sweep
def test_a_slab_in_the_way_is_named_with_the_size_that_lets_pass(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """At that size there is a plan."""
    monkeypatch.setattr(by_map, "LOOKS", LOOKS)
    with pytest.raises(
        InfeasibleError, match=r"with slab at \d+ % .* without, it ends where LF goes to LF-high"
    ) as error:
        unproven(scenario(blocked(1.0)), robot)
    assert error.value.constraint == "passage"
    assert not error.value.proven
    said: Any = error.value.to_json()["relaxed"]
    assert 0.7 < said["amount"] < 0.9
    assert unproven(scenario(blocked(said["amount"])), robot).check.ok


def hold_moved_away(wall: dict[str, Any]) -> None:
    wall["holds"][1]["position_m"] = [0.14, -0.55]


def grease(wall: dict[str, Any]) -> None:
    wall["contact"].update(spine_shear_N=0)
    for part in wall["holds"]:
        part["friction"] = 0.02


WRONG: dict[str, tuple[Change, str]] = {
    "start out of reach": (
        hold_moved_away,
        r"start\.grasps\.RF\.hold: RF-low: out of reach by 47 mm .* y = -0\.550 m .* -0\.441\.\.-0\.275 m",
    ),
    "start slips": (grease, r"start\.grasps: .*not in equilibrium.* \d+\.\d N"),
    "body too low": (
        lambda wall: wall["start"]["body"].update(position_m=[0, 0, 0.1]),
        r"start\.body\.position_m\[2\]: 0\.1: expected 0\.165",
    ),
    "body tilted": (
        lambda wall: wall["start"]["body"].update(rpy_deg=[13, 0, 0]),
        r"start\.body\.rpy_deg: 13, 0: .* 11\.5 degrees",
    ),
    "hold too wide": (
        lambda wall: wall["holds"][0].update(size_m=[0.12, 0.06, 0.06]),
        r"start\.grasps\.LF: .* 0\.12 m wide",
    ),
    "hold too flat": (
        lambda wall: wall["holds"][0].update(size_m=[0.06, 0.06, 0.03]),
        r"start\.grasps\.LF: .* 0\.03 m high",
    ),
    "squeeze too strong": (lambda wall: wall["contact"].update(max_normal_N=90), r"contact\.max_normal_N: 90: .* 60 N"),
}


@pytest.mark.parametrize("case", WRONG.values(), ids=WRONG.keys())
def test_a_start_that_cannot_be_is_the_scenarios_error(robot: Robot, case: tuple[Change, str]) -> None:
    change, message = case
    wall = two_rows()
    change(wall)
    with pytest.raises(ScenarioError, match=message):
        unproven(scenario(wall), robot)


def test_an_unknown_method_names_those_there_are(robot: Robot) -> None:
    with pytest.raises(ScenarioError, match=r"planner\.method: magic: expected .*auto"):
        unproven(scenario(two_rows()), robot, method="magic")


def test_a_time_limit_that_is_too_short_is_told(robot: Robot) -> None:
    with pytest.raises(InfeasibleError) as error:
        unproven(scenario(two_rows()), robot, time_limit_s=1e-3)
    assert error.value.constraint == "time limit"


def test_a_goal_that_no_hold_leads_to_is_not_said_to_be_out_of_reach() -> None:
    """Its holds are farther ahead and behind than boxes of reach go, and within the map."""
    wall = two_rows(all_limbs=False, slope_deg=90.0, steps=100)
    ends = {limb: (0.7 + math.copysign(0.38, x_m), y_m) for limb, (x_m, y_m) in FEET.items()}
    wall["holds"] = wall["holds"][:4] + [hold(f"far-{limb}", *place_m) for limb, place_m in ends.items()]
    wall["goal"] = {"body": {"position_m": [0.7, 0.0, 0.185]}}
    with pytest.raises(InfeasibleError, match="leads no nearer to the goal than LF ") as told:
        crux_planner.plan(leaning({"+x": 6.0, "-x": 6.0}, wall, 0.06), "scaler", time_limit_s=6.0)
    assert "beyond the reach" not in str(told.value)
