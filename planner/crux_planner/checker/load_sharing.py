"""The wrenches that the controller will make of the plan's, and the joint torques that these ask for.

Between the knots the body and a limb in the air move on under the plan's wrenches; the controller shares the load anew
about the centre of mass. So a joint may be asked for more than the plan's wrenches need.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crux_planner.checker import tolerances
from crux_planner.checker.equilibrium import corrected_wrenches
from crux_planner.checker.geometry import Array, turned_back
from crux_planner.checker.kinematics import LimbMotion
from crux_planner.checker.limb_model import WholeRobot
from crux_planner.checker.report import Findings, PeakTorque
from crux_planner.checker.sampling import Samples


def along_plane(feet_w_m: Array, force_w: Array) -> Array:
    """Forces (T, 4, 3) of point feet at (T, 4, 3) with what acts along the wall shared by how hard each foot presses.

    Least sum of |f_t|^2 / f_z with the same normal forces and the same sums of forces and moments: the controller's
    sharing, which keeps a foot that presses less than planned inside its friction.
    """
    weight = np.maximum(force_w[:, :, 2], 0.0)[:, :, None]
    root = np.sqrt(weight[:, :, 0])
    centred = feet_w_m - feet_w_m.mean(axis=1, keepdims=True)
    x, y = centred[:, :, 0], centred[:, :, 1]
    effects = np.zeros((len(force_w), 3, 4, 2))  # of each foot's force on the sums along x, along y and about z
    effects[:, 0, :, 0] = effects[:, 1, :, 1] = 1.0
    effects[:, 2, :, 0], effects[:, 2, :, 1] = -y, x
    sums = np.einsum("tilj,tlj->ti", effects, force_w[:, :, :2])
    scaled = (effects * root[:, None, :, None]).reshape(len(force_w), 3, 8)
    least = np.einsum("tji,ti->tj", np.linalg.pinv(scaled), sums)
    shared = force_w.copy()
    shared[:, :, :2] = root[:, :, None] * least.reshape(-1, 4, 2)
    return shared


def shared_load(
    samples: Samples, centre_w_m: Array, net: tuple[Array, Array] | None, twist_length_m: float
) -> tuple[Samples, Array]:
    """The samples with the wrenches that the controller makes of the plan's: balanced about the centre of mass
    (T, 3) and, on feet, with what acts along the wall shared anew. And what no correction removes, (T,).

    `net` are the force and moment that point feet must have together; None for grasps, whose forces sum as planned.
    """
    force, moment, left = corrected_wrenches(samples, twist_length_m, centre_w_m, net, point_model=net is not None)
    if net is not None:
        force = along_plane(samples.gripper_position, force)
    return replace(samples, force=force, moment=moment), left


def check_torques(
    samples: Samples, motions: list[LimbMotion], robot: WholeRobot, gravity_w: Array, findings: Findings
) -> PeakTorque:
    """No joint is asked for more than it can give, with the shared wrenches in `samples` acting at the grippers'
    centres; returns the joint and moment that come closest to that, or furthest beyond.
    """
    gravity_b = turned_back(samples.rotation, gravity_w)
    torques = []
    for index, (limb, motion) in enumerate(zip(robot.limbs, motions, strict=True)):
        wrench_b = [turned_back(samples.rotation, part[:, index]) for part in (samples.force, samples.moment)]
        torque = limb.gravity_torque(motion.state, gravity_b) + limb.contact_torque(motion.state, *wrench_b)
        torques.append(np.where(motion.reached[:, None], np.abs(torque), 0.0))
        for joint, size in zip(limb.joints, torques[-1].T, strict=True):
            findings.add_series(
                "joint_torque_shared",
                np.where(motion.reached, size - joint.effort, -np.inf),
                samples.time_s,
                "N m",
                tolerance=tolerances.TORQUE_NM,
                limb=index,
                detail=joint.name,
            )
    size = np.stack(torques)
    efforts = np.array([[joint.effort for joint in limb.joints] for limb in robot.limbs])
    i, row, j = np.unravel_index(int(np.argmax(size / efforts[:, None])), size.shape)
    name, joint = robot.limbs[i].name, robot.limbs[i].joints[j]
    return PeakTorque(name, joint.name, float(samples.time_s[row]), float(size[i, row, j]), joint.effort)
