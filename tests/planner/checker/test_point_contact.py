"""Feet on the surface itself: friction cone of the wall, no pairs, no holds."""

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs import limb_knot_t, plan_knot_t, plan_t
from crux_planner.checker import CheckReport, check_plan

from . import synthetic

ROBOT = load_robot("scaler")
FEET = {"LF": (0.14, 0.36), "RF": (0.14, -0.36), "LR": (-0.14, 0.36), "RR": (-0.14, -0.36)}
SCENARIO = """\
version: 1
name: stand
robot: scaler
wall: {{slope_deg: {slope}, friction: 0.6}}
contact: {{model: point, max_normal_N: 60}}
start:
  body: {{position_m: [0.0, 0.0, 0.185]}}
  feet: {{LF: [0.14, 0.36], RF: [0.14, -0.36], LR: [-0.14, 0.36], RR: [-0.14, -0.36]}}
goal:
  body: {{position_m: [0.0, 0.0, 0.185], tolerance_m: 0.01, tolerance_deg: 3}}
horizon: {{steps: 3, dt_s: 0.08}}
"""


def stand(slope_deg: float) -> plan_t:
    """Four feet, every knot the same, forces by least squares from the equilibrium."""
    plan = plan_t()
    plan.format, plan.robot_name, plan.scenario_name, plan.dt_s = plan_t.FORMAT, "scaler", "stand", 0.08
    plan.scenario_yaml = SCENARIO.format(slope=slope_deg)
    plan.gravity_w_m_s2 = synthetic.gravity_w(slope_deg).tolist()
    plan.max_normal_n, plan.goal_tolerance_m, plan.goal_tolerance_rad = 60.0, 0.01, float(np.deg2rad(3))
    columns = []
    centre = synthetic.centre_of_mass(_knot(0.0, np.zeros((4, 3)), above=ROBOT.gripper.pad_radius_m))
    for x, y in FEET.values():
        arm = np.array([x, y, 0.0]) - centre
        columns += [np.concatenate([unit, np.cross(arm, unit)]) for unit in np.eye(3)]
    wanted = np.concatenate([-9.6 * synthetic.gravity_w(slope_deg), np.zeros(3)])
    forces = np.linalg.lstsq(np.array(columns).T, wanted, rcond=None)[0].reshape(4, 3)
    plan.knots = [_knot(0.08 * k, forces) for k in range(4)]
    plan.n_knots = 4
    return synthetic.sign(plan)


def _knot(time_s: float, forces: np.ndarray, above: float = 0.0) -> plan_knot_t:
    knot = plan_knot_t()
    knot.time_s, knot.body_position_w_m = time_s, [0.0, 0.0, 0.185]
    for limb, (xy, force) in enumerate(zip(FEET.values(), forces, strict=True)):
        foot = limb_knot_t()
        foot.phase, foot.hold, foot.finger1_face, foot.friction = 0, -1, limb_knot_t.FACE_WALL, 0.6
        foot.gripper_position_w_m = [*xy, above]
        foot.finger_force_w_n = [*force.tolist(), 0.0, 0.0, 0.0]
        knot.limbs[limb] = foot
    return knot


def checked(plan: plan_t) -> CheckReport:
    return check_plan(synthetic.sign(plan), ROBOT)


def test_a_stand_passes() -> None:
    assert checked(stand(0.0)).violations == []
    assert checked(stand(10.0)).violations == []


def test_a_slope_steeper_than_friction() -> None:
    """At 40 degrees tan(40) = 0.84 > 0.6: every foot that slips does so by |ft| - 0.6 fn."""
    plan = stand(40.0)
    expected = {}
    for name, limb in zip(FEET, plan.knots[0].limbs, strict=True):
        fx, fy, fz = limb.finger_force_w_n[:3]
        if (beyond := float(np.hypot(fx, fy)) - 0.6 * max(fz, 0.0)) > 0.0:  # the front feet would have to pull
            expected[name] = beyond
    found = {v.limb: v.amount for v in checked(plan).violations if v.constraint == "limit_surface"}
    assert len(expected) >= 2
    assert found == pytest.approx(expected)


def test_feet_off_the_surface_or_on_a_hold() -> None:
    plan = stand(0.0)
    for knot in plan.knots:
        knot.limbs[2].gripper_position_w_m = [-0.14, 0.36, 0.002]
    found = [v for v in checked(plan).violations if v.constraint == "contact_face"]
    assert {v.limb: v.amount for v in found} == pytest.approx({"LR": 0.002})
    plan = stand(0.0)
    plan.knots[1].limbs[3].finger1_face = 0
    assert "hold" in {v.constraint for v in checked(plan).violations}


def test_a_foot_elsewhere_than_the_scenario_starts() -> None:
    plan = stand(0.0)
    plan.scenario_yaml = plan.scenario_yaml.replace("LR: [-0.14, 0.36]", "LR: [-0.14, 0.35]")
    found = [v for v in checked(plan).violations if v.constraint == "start_grasp"]
    assert {v.limb: v.amount for v in found} == pytest.approx({"LR": 0.01})
