"""The joint torques that the controller will ask for, as information beside the plan's own.

P1 has all mass at the body's origin; the controller shares the load anew about the true centre of mass, which the limbs
pull some centimetres away from there. So a joint may be asked for more than the plan's wrenches need.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crux_planner.checker.equilibrium import corrected_wrenches
from crux_planner.checker.geometry import Array, turned, turned_back
from crux_planner.checker.kinematics import LimbMotion
from crux_planner.checker.limb_model import WholeRobot
from crux_planner.checker.report import PeakTorque
from crux_planner.checker.sampling import Samples, on_pads


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


def largest_torque(
    samples: Samples,
    motions: list[LimbMotion],
    robot: WholeRobot,
    gravity_w: Array,
    *,
    twist_length_m: float,
    pad_radius_m: float | None,
) -> PeakTorque:
    """The joint and moment that come closest to, or furthest beyond, what a joint can give.

    `pad_radius_m` is None for patch contacts, and that of the pads which point feet stand on.
    """
    centre = samples.body_position + turned(samples.rotation, robot.centre_of_mass([m.state for m in motions]))
    force, moment, _ = corrected_wrenches(samples, twist_length_m, pad_radius_m is not None, centre)
    shared = replace(samples, force=force, moment=moment)
    if pad_radius_m is not None:
        shared = on_pads(replace(shared, force=along_plane(samples.gripper_position, force)), pad_radius_m)
    gravity_b = turned_back(samples.rotation, gravity_w)
    torques = []
    for index, (limb, motion) in enumerate(zip(robot.limbs, motions, strict=True)):
        wrench_b = [turned_back(samples.rotation, part[:, index]) for part in (shared.force, shared.moment)]
        torque = limb.gravity_torque(motion.state, gravity_b) + limb.contact_torque(motion.state, *wrench_b)
        torques.append(np.where(motion.reached[:, None], np.abs(torque), 0.0))
    size = np.stack(torques)
    efforts = np.array([[joint.effort for joint in limb.joints] for limb in robot.limbs])
    i, row, j = np.unravel_index(int(np.argmax(size / efforts[:, None])), size.shape)
    name, joint = robot.limbs[i].name, robot.limbs[i].joints[j]
    return PeakTorque(name, joint.name, float(samples.time_s[row]), float(size[i, row, j]), joint.effort)
