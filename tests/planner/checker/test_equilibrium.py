"""Between the knots: the correction balances, is the least one, and is refused where the holds cannot give it."""

import copy

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.checker.equilibrium import corrected_wrenches, tumble_margin
from crux_planner.checker.limit_surface import finger_loads
from crux_planner.checker.plan_arrays import PlanArrays, read_plan
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import sample

from . import synthetic
from .broken import VALID, add, broken, only

ROBOT = load_robot("scaler")


def arrays(plan: plan_t) -> PlanArrays:
    read = read_plan(plan, Findings())
    assert read is not None
    return read


def test_corrected_wrenches_balance_about_the_moving_body() -> None:
    samples = sample(arrays(VALID))
    force, moment, left = corrected_wrenches(samples, ROBOT.control.twist_length_m, samples.body_position, None)
    arm = samples.gripper_position - samples.body_position[:, None, :]
    np.testing.assert_allclose((np.cross(arm, force) + moment).sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(force.sum(axis=1), samples.force.sum(axis=1), atol=1e-9)
    assert left.max() < 1e-9
    air = samples.load[:, 1] == 0.0
    assert air.any()
    assert np.abs(force[air, 1]).max() == 0.0


def test_the_correction_is_the_least_one() -> None:
    """Against NumPy's minimum-norm least squares at one moment in full stance."""
    samples, length = sample(arrays(VALID)), 0.03
    row = 5
    force, moment, _ = corrected_wrenches(samples, length, samples.body_position, None)
    arm = samples.gripper_position[row] - samples.body_position[row]
    columns = []
    for limb in range(4):
        for unit in np.eye(3):
            columns.append(np.concatenate([unit, np.cross(arm[limb], unit)]))
        columns.append(np.concatenate([np.zeros(3), length * samples.opening_axis[row, limb]]))
    lack = -(np.cross(arm, samples.force[row]) + samples.moment[row]).sum(axis=0)
    least = np.linalg.lstsq(np.array(columns).T, np.concatenate([np.zeros(3), lack]), rcond=None)[0].reshape(4, 4)
    np.testing.assert_allclose(force[row] - samples.force[row], least[:, :3], atol=1e-9)
    change = moment[row] - samples.moment[row]
    np.testing.assert_allclose(change, length * least[:, 3:] * samples.opening_axis[row], atol=1e-9)


def test_a_wrench_blended_onto_a_limb_still_in_the_air() -> None:
    """LR lets go in the very knot in which RF lands: the blend towards that knot loads RF before it stands."""

    def change(plan: plan_t) -> None:
        for knot in plan.knots[7:9]:
            limb = knot.limbs[2]
            limb.phase, limb.hold, limb.finger1_face, limb.friction = 1, -1, -1, 0.0
            limb.finger_force_w_n, limb.finger_moment_w_nm = [0.0] * 6, [0.0] * 6

    found = only(broken(change), "air_force_between_knots")
    assert [v.limb for v in found] == ["RF"]
    assert 6 * synthetic.DT_S < (found[0].time_s or 0.0) < 7 * synthetic.DT_S


def test_a_body_that_leans_out_too_far_between_knots() -> None:
    """Knots of 60 s: at 8 mm/s the body would be half a metre away before the wrenches follow."""

    def change(plan: plan_t) -> None:
        for knot in plan.knots[1:-1]:
            add(knot, "body_position_w_m", 2, 2.5)

    found = only(broken(change), "limit_surface_between_knots")
    assert found[0].amount > 0.5


def test_holds_too_weak_for_the_correction() -> None:
    """The same motion with a normal force limit below what the corrected wrenches need."""
    plan = copy.deepcopy(VALID)
    plan.max_normal_n = 2.0
    found = only(check_plan(plan, ROBOT), "limit_surface_between_knots")
    assert {v.limb for v in found} == {"LF", "RF", "LR", "RR"}


def tumble(slope_deg: float) -> float:
    plan = synthetic.make_plan(slope_deg)
    read = arrays(plan)
    for knot in plan.knots:
        for limb in knot.limbs:
            limb.finger_force_w_n = [0.0] * 6
    read = arrays(plan)
    loads = finger_loads(read, 0.6)
    without_spines = type(loads)(**{**vars(loads), "spine_shear_N": np.zeros_like(loads.spine_shear_N)})
    margin = tumble_margin(read, without_spines, 9.6)
    assert margin is not None
    return margin


def test_tumble_margin_without_any_pull_is_the_distance_to_the_support_edge() -> None:
    """On the flat with empty hands: with RF in the air the edge runs from LF to RR, 20 mm of body motion across it."""
    legs = {name: np.array(synthetic.HOLDS[name]) for name in ("a", "d")}
    edge = (legs["d"] - legs["a"]) / np.linalg.norm(legs["d"] - legs["a"])
    distances = []
    for knot in VALID.knots[synthetic.FIRST_AIR : synthetic.LAST_AIR + 1]:
        body = np.array(knot.body_position_w_m[:2]) - legs["a"]
        towards_lr = np.array(synthetic.HOLDS["c"]) - legs["a"]
        side = np.sign(edge[0] * towards_lr[1] - edge[1] * towards_lr[0])
        distances.append(side * (edge[0] * body[1] - edge[1] * body[0]))
    assert tumble(0.0) == pytest.approx(min(distances), abs=1e-9)


def test_a_vertical_wall_tumbles_without_pull() -> None:
    """Gravity acts body height away from the wall: M_ab/(m g) is that height (across the level edge of two holds)."""
    assert tumble(90.0) == pytest.approx(-synthetic.BODY_Z_M + synthetic.PAD_Z_M, abs=1e-9)
