"""The torque that the controller will ask for, against the whole robot's statics by pinocchio."""

import copy
import hashlib
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from crux_contracts.interpolation import PlanReference
from crux_contracts.robot import Robot, load_robot
from crux_planner.checker import check_plan
from crux_planner.checker.equilibrium import along_plane
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model

from .broken import VALID

ROBOT = load_robot("scaler")


def test_the_largest_torque_holds_the_robot_at_its_true_centre_of_mass() -> None:
    """At the moment that is reported: the contacts carry the free robot's weight and its moment, and the joint does
    what is left."""
    report = check_plan(VALID, ROBOT)
    peak = report.largest_torque
    assert peak is not None
    plain = next(load for load in report.joints if load.joint == peak.joint).peak_torque_Nm
    assert abs(peak.torque_Nm - plain) > 0.01  # so that it matters what the load is shared about

    reference = PlanReference(VALID)
    k, u = reference.at(peak.time_s)
    (position, rpy), grippers = reference.body(peak.time_s), [reference.limb(i, k, u) for i in range(4)]
    body = pin.rpy.rpyToMatrix(rpy)
    model: Any = pin.buildModelFromUrdf(str(ROBOT.urdf_path), pin.JointModelFreeFlyer())
    model.gravity.linear = np.array(VALID.gravity_w_m_s2)
    still = pin.neutral(model)
    still[:3], still[3:7] = position, pin.Quaternion(body).coeffs()
    for limb, gripper in zip(load_model(ROBOT).limbs, grippers, strict=True):
        turn = body.T @ pin.rpy.rpyToMatrix(0.0, 0.0, float(gripper.yaw_w_rad))
        (found,) = solve([limb], [(body.T @ (gripper.position_w_m - position))[None]], [turn[None]])
        names = [joint.name for joint in limb.joints] + [joint.name for joint in limb.fingers]
        for name, value in zip(names, [*found.q_rad[0], *[float(gripper.opening_m)] * 2], strict=True):
            still[model.joints[model.getJointId(name)].idx_q] = value

    # least change of the planned wrenches (force, twist about the finger axis) that holds the weight at its centre
    data = model.createData()
    arms = np.array([g.position_w_m for g in grippers]) - pin.centerOfMass(model, data, still)
    axes = [np.array([np.cos(g.yaw_w_rad), np.sin(g.yaw_w_rad), 0.0]) for g in grippers]
    wrenches = np.array([reference.wrench(i, k, u) for i in range(4)])
    loads = [float(reference.load(i, k, u)) for i in range(4)]
    columns, twist_m = [], ROBOT.control.twist_length_m
    for arm, axis, load in zip(arms, axes, loads, strict=True):
        across = np.vstack([np.eye(3), pin.skew(arm)])
        columns.append(np.sqrt(load) * np.column_stack([across, [*np.zeros(3), *(twist_m * axis)]]))
    lack = -(np.cross(arms, wrenches[:, :3]) + wrenches[:, 3:]).sum(axis=0)
    least = np.linalg.lstsq(np.hstack(columns), np.concatenate([np.zeros(3), lack]), rcond=None)[0].reshape(4, 4)

    external = pin.StdVec_Force()
    external.extend([pin.Force.Zero() for _ in range(model.njoints)])
    pin.framesForwardKinematics(model, data, still)
    for i, described in enumerate(ROBOT.limbs):
        change = np.sqrt(loads[i]) * least[i]
        force, moment = wrenches[i, :3] + change[:3], wrenches[i, 3:] + twist_m * change[3] * axes[i]
        frame_id = model.getFrameId(described.gripper_link, pin.FrameType.BODY)
        frame, rotation = model.frames[frame_id], data.oMf[frame_id].rotation
        external[frame.parentJoint] = frame.placement.act(pin.Force(rotation.T @ force, rotation.T @ moment))
    zero = np.zeros(model.nv)
    torque = pin.rnea(model, model.createData(), still, zero, zero, external)
    np.testing.assert_allclose(torque[3:6], 0.0, atol=1e-2)  # nothing turns the body
    asked = abs(torque[model.joints[model.getJointId(peak.joint)].idx_v])
    assert peak.torque_Nm == pytest.approx(asked, abs=1e-3)
    assert peak.share == pytest.approx(asked / peak.effort_limit_Nm, abs=1e-3)


def test_feet_share_what_acts_along_the_wall_by_how_hard_they_press() -> None:
    """Feet that pull at each other without need are told not to, and one in the air is left out."""
    random = np.random.default_rng(5)
    feet = np.zeros((20, 4, 3))
    feet[..., :2] = np.array([[0.14, 0.36], [0.14, -0.36], [-0.14, 0.36], [-0.14, -0.36]])
    feet[..., :2] += random.uniform(-0.05, 0.05, (20, 4, 2))
    normal = random.uniform(2.0, 40.0, (20, 4))
    normal[:10, 2] = 0.0
    alike = normal[..., None] * np.array([0.36, 0.05, 1.0])
    pull = random.uniform(-60.0, 60.0, (20, 1)) * (feet[:, 1] - feet[:, 0])
    given = alike.copy()
    given[:, 0] += pull
    given[:, 1] -= pull
    np.testing.assert_allclose(along_plane(feet, given), alike, atol=1e-9)

    given[..., :2] += random.uniform(-5.0, 5.0, (20, 4, 2)) * (normal > 0.0)[..., None]  # now the body is turned, too
    shared = along_plane(feet, given)
    np.testing.assert_allclose(shared.sum(axis=1), given.sum(axis=1), atol=1e-9)
    np.testing.assert_allclose(np.cross(feet, shared).sum(axis=1), np.cross(feet, given).sum(axis=1), atol=1e-9)


def _all_but_lf_joint3(effort_Nm: float, name: str, full_Nm: float) -> float:
    return effort_Nm if name == "LF_joint3" else full_Nm


def test_a_joint_too_weak_for_the_load_as_it_is_shared(
    weak_robot: Callable[[Callable[[str, float], float]], Robot],
) -> None:
    """LF_joint3 needs 2.21 N m for the plan's own wrenches, and more as the controller shares the load: with what is
    between, exactly that is violated; with as much as it needs, nothing.
    """
    plan = copy.deepcopy(VALID)
    amounts = []
    for effort_Nm in (2.3, 2.35, 2.45):
        robot = weak_robot(partial(_all_but_lf_joint3, effort_Nm))
        plan.robot_sha256, plan.plan_id = robot.hash, ""
        plan.plan_id = hashlib.sha256(plan.encode()).hexdigest()
        report = check_plan(plan, robot)
        assert {(v.constraint, v.limb, v.detail) for v in report.violations} <= {
            ("joint_torque_shared", "LF", "LF_joint3")
        }
        amounts.append(max((v.amount for v in report.violations), default=0.0))
        assert report.largest_torque is not None
        if amounts[-1] > 0.0:
            assert report.largest_torque.torque_Nm == pytest.approx(effort_Nm + amounts[-1])
    assert amounts[0] > 0.1
    assert amounts[1] == pytest.approx(amounts[0] - 0.05)
    assert amounts[2] == 0.0
