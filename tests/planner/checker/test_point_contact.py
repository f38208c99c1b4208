"""Feet on the surface itself: friction cone of the wall, no pairs, no holds."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from crux_contracts.interpolation import PlanReference
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_msgs import limb_knot_t, plan_knot_t, plan_t
from crux_planner.checker import CheckReport, check_plan
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from shared_plans import SharedPlans

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


def _posture(model: Any, plan: plan_t, time_s: float) -> Any:
    """Pinocchio's configuration along a plan on feet."""
    reference = PlanReference(plan)
    k, u = reference.at(time_s)
    position, rpy = reference.body(time_s)
    body, q = pin.rpy.rpyToMatrix(rpy), pin.neutral(model)
    q[:3], q[3:7] = position, pin.Quaternion(body).coeffs()
    for i, limb in enumerate(load_model(ROBOT).limbs):
        foot = reference.limb(i, k, u)
        gripper = foot.position_w_m + np.array([0.0, 0.0, ROBOT.gripper.pad_radius_m])
        turn = body.T @ pin.rpy.rpyToMatrix(0.0, 0.0, float(foot.yaw_w_rad))
        (found,) = solve([limb], [(body.T @ (gripper - position))[None]], [turn[None]])
        names = [joint.name for joint in limb.joints] + [joint.name for joint in limb.fingers]
        for name, value in zip(names, [*found.q_rad[0], *[float(foot.opening_m)] * 2], strict=True):
            q[model.joints[model.getJointId(name)].idx_q] = value
    return q


def _momentum(model: Any, plan: plan_t, time_s: float) -> np.ndarray:
    """Momentum, and angular momentum about W's origin, (6,)."""
    data, step_s = model.createData(), 1e-3
    ends = [_posture(model, plan, time_s + late) for late in (-step_s, step_s)]
    velocity, middle = pin.difference(model, *ends) / (2 * step_s), _posture(model, plan, time_s)
    found = pin.computeCentroidalMomentum(model, data, middle, velocity)
    return np.concatenate([found.linear, found.angular + np.cross(data.com[0], found.linear)])


def test_a_foot_that_has_to_pull_while_a_leg_is_thrown_up(planned: SharedPlans) -> None:
    """RR's step is 12 mm higher just after it has lifted off: LF, across from it, would have to pull. By how much says
    pinocchio, in the mean over 40 ms.
    """
    scene = Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "walk-flat.yaml"
    plan = planned(load_scenario(scene), ROBOT).plan
    assert check_plan(plan, ROBOT).ok
    plan = copy.deepcopy(plan)
    air = [k for k, knot in enumerate(plan.knots) if knot.limbs[3].phase != limb_knot_t.STANCE]
    foot = plan.knots[air[1]].limbs[3]
    foot.gripper_position_w_m = np.add(foot.gripper_position_w_m, [0.0, 0.0, 0.012]).tolist()
    report = checked(plan)
    assert {v.constraint for v in report.violations} == {"foot_pull", "moment_balance"}  # for the leg's mass is higher
    (pull,) = [v for v in report.violations if v.constraint == "foot_pull"]
    assert pull.limb == "LF"
    assert pull.time_s is not None
    assert air[0] * plan.dt_s < pull.time_s < air[1] * plan.dt_s

    model: Any = pin.buildModelFromUrdf(str(ROBOT.urdf_path), pin.JointModelFreeFlyer())
    rate = np.zeros(6)
    for sign in (-1, 1):
        rate += sign * _momentum(model, plan, pull.time_s + sign * plan.dt_s / 4) / (plan.dt_s / 2)
    weight = 9.6 * np.array(plan.gravity_w_m_s2)
    centre = pin.centerOfMass(model, model.createData(), _posture(model, plan, pull.time_s))
    force, moment = rate[:3] - weight, rate[3:] - np.cross(centre, weight)
    reference = PlanReference(plan)
    feet = np.array([reference.limb(i, *reference.at(pull.time_s)).position_w_m for i in range(3)])
    sums = np.vstack([np.ones(3), feet[:, 0], feet[:, 1]])
    loads = np.linalg.solve(sums, [force[2], -moment[1], moment[0]])
    assert -loads[0] == pytest.approx(pull.amount, abs=1.0)  # the checker's velocities are means over up to 7 ms
