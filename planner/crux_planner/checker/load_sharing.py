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
        shared = on_pads(shared, pad_radius_m)
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
