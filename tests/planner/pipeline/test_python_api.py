"""What planning from Python takes and returns: dicts with NumPy's numbers, arrays, data frames, a short repr."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import crux_planner
import numpy as np
import pytest
import yaml
from crux_contracts.robot import RobotError, load_robot
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_planner.checker import check_plan
from crux_planner.pipeline.restart import rewritten
from crux_tools.paths import SCENARIOS
from shared_plans import SharedPlans

WALL = SCENARIOS / "climb-one-step.yaml"


@pytest.fixture(scope="module")
def result() -> crux_planner.PlanResult:
    wall = yaml.safe_load(WALL.read_text(encoding="utf-8"))
    for hold in wall["holds"]:
        hold["position_m"], hold["friction"] = np.array(hold["position_m"]), np.float64(hold["friction"])
    wall["horizon"]["steps"] = np.int64(wall["horizon"]["steps"])
    return crux_planner.plan(wall, "scaler")


def test_a_dict_gives_the_plan_of_its_yaml(result: crux_planner.PlanResult, planned: SharedPlans) -> None:
    of_yaml = planned(load_scenario(WALL), load_robot("scaler"), proven=True)
    mine, theirs = ([knot.encode() for knot in each.plan.knots] for each in (result, of_yaml))
    assert mine == theirs
    assert (result.cost, result.gap, result.gait) == (of_yaml.cost, of_yaml.gap, of_yaml.gait)


def test_a_robot_may_be_named_everywhere(result: crux_planner.PlanResult) -> None:
    robot = load_robot("scaler")
    assert check_plan(result.plan, robot.folder).ok
    assert crux_planner.Planner(load_scenario(WALL), "scaler").robot == robot
    for wrong, error, match in (("no-such", RobotError, "no-such/robot.yaml"), (None, TypeError, "not NoneType")):
        with pytest.raises(error, match=match):
            crux_planner.plan(load_scenario(WALL), wrong)  # type: ignore[arg-type]


def test_arrays_are_the_plan(result: crux_planner.PlanResult) -> None:
    plan, arrays = result.plan, result.arrays
    k, limb = len(plan.knots) // 2, 2
    knot = plan.knots[k]
    assert arrays.time_s == pytest.approx([knot.time_s for knot in plan.knots])
    assert arrays.body_velocity_m_s[k].tolist() == list(knot.body_velocity_w_m_s)
    assert arrays.body_angular_velocity_b_rad_s[k].tolist() == list(knot.body_angular_velocity_b_rad_s)
    assert arrays.gripper_position_m[k, limb].tolist() == list(knot.limbs[limb].gripper_position_w_m)
    assert arrays.finger_force_n[k, limb].ravel().tolist() == list(knot.limbs[limb].finger_force_w_n)
    assert arrays.friction[k, limb] == knot.limbs[limb].friction
    assert arrays.hold_names[arrays.hold[0, 0]] == "left-front-low"
    assert arrays.hold_names[arrays.hold[-1, 0]] == "left-front-high"
    assert (arrays.stance == (arrays.hold >= 0)).all()
    assert not arrays.stance[:, 0].all()
    weight_n = load_robot("scaler").total_mass_kg * np.array(plan.gravity_w_m_s2)
    assert arrays.force_n[0].sum(axis=0) == pytest.approx(-weight_n, abs=0.5)  # at rest
    assert np.abs(arrays.wrench[~arrays.stance]).max() == 0.0


def test_its_repr_is_a_few_lines(result: crux_planner.PlanResult) -> None:
    for thing in (result, result.check, result.arrays):
        assert len(repr(thing).splitlines()) <= 5
        assert len(repr(thing)) < 500
    for word in ("climb-one-step", "scaler", f"{result.steps} steps", f"{result.cost:.3f}", "CheckReport: ok"):
        assert word in repr(result)
    assert f"gap at most {100 * (result.gap or 0):.0f} %" in repr(result)


def test_the_repr_of_a_report_names_what_is_not_met(result: crux_planner.PlanResult) -> None:
    plan = type(result.plan).decode(result.plan.encode())
    for knot in plan.knots:
        knot.body_position_w_m = [*knot.body_position_w_m[:2], 0.3]
    report = check_plan(plan, load_robot("scaler"))
    assert f"{len(report.violations)} violations" in repr(report)
    assert report.violations[0].constraint in repr(report)


def test_a_data_frame_has_a_row_a_knot(result: crux_planner.PlanResult, monkeypatch: pytest.MonkeyPatch) -> None:
    def frame(columns: dict[str, Any], index: Any) -> Any:
        return SimpleNamespace(columns=columns, index=index)

    pandas = SimpleNamespace(DataFrame=frame, Index=lambda values, name: (name, values))
    monkeypatch.setitem(sys.modules, "pandas", pandas)  # which crux does not install
    table: Any = result.to_dataframe()
    arrays = result.arrays
    assert table.index[0] == "time_s"
    assert table.index[1].tolist() == arrays.time_s.tolist()
    assert all(column.shape == arrays.time_s.shape for column in table.columns.values())
    assert len(table.columns) == 12 + 4 * (5 + 3 + 2 + 6 + 12 + 1)
    assert table.columns["body_rpy_rad_yaw"].tolist() == arrays.body_rpy_rad[:, 2].tolist()
    assert table.columns["RR_wrench_mz"].tolist() == arrays.wrench[:, 3, 5].tolist()
    assert table.columns["LR_finger_force_n_2_y"].tolist() == arrays.finger_force_n[:, 2, 1, 1].tolist()
    assert table.columns["LF_gripper_yaw_rad"].tolist() == arrays.gripper_yaw_rad[:, 0].tolist()
    assert set(table.columns["LF_hold"]) == {"left-front-low", "", "left-front-high"}


def test_without_pandas_it_says_what_to_install(
    result: crux_planner.PlanResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        result.to_dataframe()


@pytest.mark.parametrize("name", ["on", "1:30", "010", "1e3"])
def test_names_that_older_yaml_takes_for_numbers_survive_a_rewritten_scenario(name: str) -> None:
    word = f"'{name}'" if name in ("010", "1e3") else name
    scenario = parse_scenario(WALL.read_text(encoding="utf-8").replace("left-front-low", word))
    assert scenario.holds[0].name == name
    again = rewritten(scenario, steps=5)
    assert (again.holds, again.start, again.horizon.steps) == (scenario.holds, scenario.start, 5)
