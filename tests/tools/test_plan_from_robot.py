"""`crux plan --from-robot`: a stance is recognised on the map from gripper poses alone, and planned on from."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, load_scenario, parse_scenario
from crux_msgs import robot_state_t
from crux_planner import Planner
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.guide.stance import scenario_from
from crux_tools.paths import ROOT
from crux_tools.telemetry.rotations import rotation_from_rpy

SCENE = Path(__file__).parents[2] / "msgs" / "scenarios" / "climb-four-holds.yaml"
PAD_M, LEAN_DEG = 0.03, 35.0
STANCE, SWING = 0, 4
LOW = ("left-front-low", "right-front-low", "left-rear-low", "right-rear-low")


def quaternion(rotation: Any) -> list[float]:
    """w, x, y, z of a rotation by less than half a turn."""
    w = math.sqrt(1.0 + np.trace(rotation)) / 2
    skew = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    return [w, *(v / (4 * w) for v in skew)]


def hanging(
    scenario: Scenario,
    holds: tuple[str, ...],
    body_m: Any,
    rpy_rad: Any,
    air: int = -1,
    state: int = robot_state_t.IDLE,
    opening_m: float = 0.031,
    off_x_m: float = 0.0,
) -> Any:
    """What a runtime says of a robot on these holds, its grippers on their x faces, so far off their middles. One that
    is IDLE without a plan does not know where the body is."""
    rotation = rotation_from_rpy(rpy_rad)
    knows = state != robot_state_t.IDLE
    shown, origin = (np.eye(3), np.zeros(3)) if knows else (rotation.T, np.array(body_m))
    body = SimpleNamespace(
        supervisor_state=state,
        body_position_w_m=list(body_m) if knows else [0.0, 0.0, 0.0],
        body_quaternion_w=quaternion(rotation) if knows else [1.0, 0.0, 0.0, 0.0],
    )
    references, telemetry = [], []
    for limb, name in enumerate(holds):
        hold = scenario.holds[scenario.hold_index(name)]
        x, y = hold.position_m
        place = np.array([x + off_x_m, y, PAD_M + (0.06 if limb == air else 0.0)])
        references.append(SimpleNamespace(phase=SWING if limb == air else STANCE, finger_opening_m=opening_m))
        telemetry.append(
            SimpleNamespace(
                gripper_position_w_m=(shown @ (place - origin)).tolist(), gripper_quaternion_w=quaternion(shown)
            )
        )
    return SimpleNamespace(state=body, reference=references, telemetry=telemetry)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario(SCENE)


def test_a_robot_put_on_by_hand_is_found(scenario: Scenario) -> None:
    body_m, rpy_rad = [0.01, -0.02, 0.19], [0.02, -0.03, 0.05]
    mixed = ("left-front-high", "right-front-low", "left-rear-low", "right-rear-low")
    moved, stance = scenario_from(scenario, load_robot("scaler"), hanging(scenario, mixed, body_m, rpy_rad), {})
    assert tuple(moved.start.grasps[limb].hold for limb in LIMB_NAMES) == mixed
    assert stance.position_W_m[:2] == pytest.approx(body_m[:2], abs=1e-6)
    assert moved.start.body.rpy_rad == pytest.approx(rpy_rad, abs=1e-6)
    assert moved.goal == scenario.goal


def test_stances_that_look_alike_are_asked_about(scenario: Scenario) -> None:
    """The upper four holds stand to each other as the lower four do."""
    robot, status = load_robot("scaler"), hanging(scenario, LOW, [0.0, 0.0, 0.185], [0.0, 0.0, 0.0])
    with pytest.raises(UsageError, match=r"look alike: .*--on LIMB=HOLD"):
        scenario_from(scenario, robot, status, {})
    moved, _ = scenario_from(scenario, robot, status, {"LF": "left-front-low"})
    assert tuple(moved.start.grasps[limb].hold for limb in LIMB_NAMES) == LOW


def test_a_runtime_that_holds_knows_which_it_is_and_a_plan_goes_on(scenario: Scenario) -> None:
    robot = load_robot("scaler")
    status = hanging(scenario, LOW, [0.0, 0.0, 0.185], [0.0, 0.0, 0.0], air=1, state=robot_state_t.HOLDING)
    moved, _ = scenario_from(scenario, robot, status, {})
    assert set(moved.start.air) == {"RF"}
    plan = Planner(moved, robot).plan(time_limit_s=20.0).plan
    assert [limb.hold >= 0 for limb in plan.knots[0].limbs] == [True, False, True, True]
    assert plan.knots[-1].body_position_w_m == pytest.approx(scenario.goal.body.position_m, abs=0.01)


def test_a_robot_is_found_on_holds_whose_faces_lean_and_one_that_has_moved_keeps_its_shape() -> None:
    """By the wall's geometry: at the pads' height a face that leans is nearer to the hold's middle."""
    robot, wall = load_robot("scaler"), yaml.safe_load((ROOT / "examples" / "leaning-holds.yaml").read_text())
    for hold in wall["holds"]:
        hold["shape"]["lean_deg"] = {"+x": LEAN_DEG}
    leaning, lean_rad = parse_scenario(wall), math.radians(LEAN_DEG)
    radius_m, half_m = robot.gripper.pad_radius_m, leaning.holds[0].size_m[0] / 2
    in_m = PAD_M * math.tan(lean_rad) - radius_m * (1 / math.cos(lean_rad) - 1)
    status = hanging(
        leaning, LOW, [0.0, 0.0, 0.185], [0.0] * 3, state=robot_state_t.HOLDING, opening_m=half_m - in_m / 2,
        off_x_m=-in_m / 2,
    )  # fmt: skip
    status.telemetry[1].gripper_position_w_m[1] -= 0.012
    moved, stance = scenario_from(leaning, robot, status, {})
    assert tuple(moved.start.grasps[limb].hold for limb in LIMB_NAMES) == LOW
    assert stance.off_m < 0.012
    assert stance.position_W_m[0] == pytest.approx(0.0, abs=0.002)
    before, after = (each.holds[each.hold_index(LOW[1])] for each in (leaning, moved))
    assert after.position_m[1] - before.position_m[1] == pytest.approx(-0.009, abs=0.002)  # the body gives in to it
    assert (after.lean_deg, after.size_m, after.yaw_deg) == (before.lean_deg, before.size_m, before.yaw_deg)


def test_what_fits_no_holds_is_said(scenario: Scenario) -> None:
    robot, status = load_robot("scaler"), hanging(scenario, LOW, [0.0, 0.0, 0.185], [0.0, 0.0, 0.0])
    status.telemetry[2].gripper_position_w_m[0] -= 0.06
    with pytest.raises(UsageError, match="fit no holds of the map"):
        scenario_from(scenario, robot, status, {})
    status.reference[2].phase = status.reference[3].phase = SWING
    with pytest.raises(UsageError, match=r"3 grippers at least .* press: LF, RF"):
        scenario_from(scenario, robot, status, {})


def test_where_limbs_may_stand_no_start_is_felt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall = ROOT / "benchmarks" / "walls" / "feet-45.yaml"
    words = ["plan", str(wall), "--from-log", str(tmp_path / "log.mcap"), "-o", str(tmp_path / "plan.mcap")]
    assert main(words) == 2
    assert "footholds: limbs may stand on foot-left-1" in capsys.readouterr().err
