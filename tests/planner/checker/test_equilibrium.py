"""Between the knots: the correction balances, is the least one, and is refused where the holds cannot give it."""

import copy
from dataclasses import fields, replace
from types import SimpleNamespace

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


def test_the_report_says_what_the_controller_adds_between_the_knots() -> None:
    """The moment of the blended wrenches about the centre of mass, which pinocchio has, at a fifth of the moments."""
    samples, report = sample(arrays(VALID)), check_plan(VALID, ROBOT)
    samples = replace(samples, **{field.name: getattr(samples, field.name)[::5] for field in fields(samples)})
    centres = []
    for row in range(len(samples.time_s)):
        limbs = [
            SimpleNamespace(
                gripper_position_w_m=samples.gripper_position[row, limb],
                gripper_yaw_w_rad=samples.gripper_yaw[row, limb],
                finger_separation_m=2 * samples.opening[row, limb],
            )
            for limb in range(4)
        ]
        body = {"body_position_w_m": samples.body_position[row], "body_rpy_rad": samples.body_rpy[row]}
        centres.append(synthetic.centre_of_mass(SimpleNamespace(**body, limbs=limbs)))
    centre = np.array(centres)
    lack = (np.cross(samples.gripper_position - centre[:, None], samples.force) + samples.moment).sum(axis=1)
    force, _, _ = corrected_wrenches(samples, ROBOT.control.twist_length_m, centre, None)
    assert report.correction is not None
    moment_Nm, force_N = np.linalg.norm(lack, axis=1).max(), np.linalg.norm(force - samples.force, axis=2).max()
    for found, some in ((report.correction.moment_Nm, moment_Nm), (report.correction.force_N, force_N)):
        assert 0.1 < some <= found + 1e-6
        assert found < 1.05 * some


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


def centres(plan: plan_t) -> np.ndarray:
    """(N, 3): the whole robot's, by pinocchio."""
    return np.array([synthetic.centre_of_mass(knot) for knot in plan.knots[:-1]])


def tumble(slope_deg: float) -> float:
    plan = synthetic.make_plan(slope_deg)
    read = arrays(plan)
    for knot in plan.knots:
        for limb in knot.limbs:
            limb.finger_force_w_n = [0.0] * 6
    read = arrays(plan)
    loads = finger_loads(read, 0.6)
    without_spines = type(loads)(**{**vars(loads), "spine_shear_N": np.zeros_like(loads.spine_shear_N)})
    margin = tumble_margin(read, without_spines, centres(plan), synthetic.MASS_KG)
    assert margin is not None
    return margin


def test_tumble_margin_without_any_pull_is_the_distance_to_the_support_edge() -> None:
    """On the flat with empty hands: of the centre of mass from the edge, from LF to RR while RF is in the air."""
    legs = {name: np.array(synthetic.HOLDS[name]) for name in ("a", "d")}
    edge = (legs["d"] - legs["a"]) / np.linalg.norm(legs["d"] - legs["a"])
    distances = []
    for knot in VALID.knots[synthetic.FIRST_AIR : synthetic.LAST_AIR + 1]:
        centre = synthetic.centre_of_mass(knot)[:2] - legs["a"]
        towards_lr = np.array(synthetic.HOLDS["c"]) - legs["a"]
        side = np.sign(edge[0] * towards_lr[1] - edge[1] * towards_lr[0])
        distances.append(side * (edge[0] * centre[1] - edge[1] * centre[0]))
    assert tumble(0.0) == pytest.approx(min(distances), abs=1e-9)


def test_a_vertical_wall_tumbles_without_pull() -> None:
    """Gravity acts as far off the wall as the centre of mass is: M_ab/(m g) is that (across two level holds)."""
    heights = centres(synthetic.make_plan(90.0))[:, 2]
    assert np.ptp(heights) > 1e-3
    assert tumble(90.0) == pytest.approx(synthetic.PAD_Z_M - heights.max(), abs=1e-9)


def test_the_report_has_the_tumble_margin_about_the_centre_of_mass() -> None:
    """Limbs have mass of their own: about the origin of the body the margin would be 4 mm more."""
    report = check_plan(VALID, ROBOT)
    read = arrays(VALID)
    loads = finger_loads(read, 0.6)
    about_mass = tumble_margin(read, loads, centres(VALID), synthetic.MASS_KG)
    about_origin = tumble_margin(read, loads, read.body_position[:-1], synthetic.MASS_KG)
    assert report.tumble_margin_m == pytest.approx(about_mass, abs=1e-6)
    assert about_mass is not None
    assert about_origin is not None
    assert abs(about_mass - about_origin) > 0.003
