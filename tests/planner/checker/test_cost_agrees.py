"""J (6) is one: what the planner minimises is what the checker counts, whatever the weights."""

import numpy as np
import pytest
from certificate_attacks import Attack, drawn_wall
from crux_contracts.robot import load_robot
from crux_contracts.scenario import WEIGHTS, Scenario, ScenarioError
from crux_planner import InfeasibleError, Planner
from crux_planner.checker.cost import cost
from crux_planner.checker.geometry import rotation_about_z
from crux_planner.checker.plan_arrays import read_plan
from crux_planner.checker.report import Findings
from crux_planner.physics.cost import plan_cost
from crux_planner.pipeline.bound_certificate import certify_bound
from crux_planner.pipeline.message import plan_message
from crux_planner.trajectory.solution import Solution
from walls import one_move, scenario, two_rows

ROBOT = load_robot("scaler")
TILTED_DEG = [2.0, -2.5, 3.0]  # so that position and orientation both count


def wall(weights: dict[str, float]) -> dict[str, object]:
    content = two_rows()
    content["start"]["body"]["rpy_deg"] = TILTED_DEG
    content["planner"] = {"weights": weights}
    return content


ODD = {"velocity": 40.0, "wrench": 5e-4, "lift": 0.5, "opening": 0.3, "switching": 1.1}


@pytest.mark.parametrize("weights", [{"body": 3.0}, {"body": 0.5, "orientation": 4.0}, {"position": 2.5, **ODD}])
def test_a_weight_means_the_same_to_planner_and_checker(weights: dict[str, float]) -> None:
    """All of them well away from their usual values."""
    assert set(WEIGHTS) == {"body", "orientation", "position", *ODD}
    read = scenario(wall(weights))
    result = Planner(read, ROBOT).plan()
    arrays = read_plan(result.plan, Findings())
    assert arrays is not None
    assert cost(arrays, read) == pytest.approx(result.cost, rel=2e-3)  # the NLP adds a little for spines


@pytest.mark.sweep  # test_certificates_hold.py has it in short
def test_a_certified_bound_is_below_a_plan_under_drawn_weights() -> None:
    """Small scenes with weights drawn: the bound of plans of so many steps is never above the plan at hand."""
    random = np.random.default_rng(11)
    for _ in range(2):
        drawn = {
            str(name): float(10 ** random.uniform(-2, 0.5)) for name in random.choice(WEIGHTS[:4], 2, replace=False)
        }
        read = scenario(wall(drawn))
        result = Planner(read, ROBOT).plan()
        arrays = read_plan(result.plan, Findings())
        assert arrays is not None
        counted = cost(arrays, read)
        bound = certify_bound(read, ROBOT, result.steps, 10 * counted)["bound"]
        assert bound < counted, drawn


def priced(read: Scenario, random: np.random.Generator) -> tuple[float, float] | None:
    """J by checker and planner of poses, speeds and wrenches at random, whether they can be or not; None: no moves."""
    try:
        begun = Attack(read).begun()
    except (ScenarioError, InfeasibleError):
        return None
    if begun is None:
        return None
    climb, schedule, start = begun
    body = start.body + random.normal(scale=0.05, size=start.body.shape)
    wrenches = [{limb: q + random.normal(scale=5.0, size=5) for limb, q in knot.items()} for knot in start.wrenches]
    solution = Solution(body, wrenches, np.nan, 0, "", True, 0.0, 0.0, {}, climb.problem.torque_limits_Nm)
    arrays = read_plan(plan_message(read, ROBOT, climb.problem, schedule, solution), Findings())
    assert arrays is not None
    return cost(arrays, read), plan_cost(climb.problem, schedule, body, wrenches)


def test_j_is_the_same_of_any_plan() -> None:
    """Weights, scenes, poses, speeds and wrenches drawn at random."""
    random, scenes = np.random.default_rng(5), 0
    for seed in range(300, 326):
        found = priced(scenario(drawn_wall(seed)), random)
        if found is not None:
            assert found[0] == pytest.approx(found[1], rel=1e-9), seed
            scenes += 1
    assert scenes > 9


@pytest.mark.parametrize(("start_deg", "goal_deg"), [(179.0, -179.0), (-179.5, 179.5), (90.0, 92.0)])
def test_j_is_the_same_where_the_yaw_passes_half_a_turn(start_deg: float, goal_deg: float) -> None:
    content = one_move(slope_deg=0.0)
    turn = rotation_about_z(np.radians(start_deg))
    for part in (*content["holds"], content["start"]["body"], content["goal"]["body"]):
        at = np.array(part["position_m"])
        part["position_m"] = [*(turn[:2, :2] @ at[:2]).tolist(), *at[2:].tolist()]
    for hold in content["holds"]:
        hold["yaw_deg"] = hold.get("yaw_deg", 0.0) + start_deg
    content["start"]["body"]["rpy_deg"], content["goal"]["body"]["rpy_deg"] = [0, 0, start_deg], [0, 0, goal_deg]
    found = priced(scenario(content), np.random.default_rng(1))
    assert found is not None
    assert found[0] == pytest.approx(found[1], rel=1e-9)
