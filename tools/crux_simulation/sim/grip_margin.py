"""How far pads really were from slipping: physics' own contacts against physics' own friction.

The normal force of each pad is that of its contact, along the normal of its face. What the pad bears along its face
follows from the whole wrench of the gripper by statics: half of the force across the normal, and the couple that a
moment across it makes on the arm between the pads; of the moment about the normal both take half, being equal. Spines
are an adhesion in physics: the contact's force contains their pull, which friction counts on, and the gripper's not.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from crux_tools.robot3d.robot_model import RobotModel
from crux_tools.telemetry.margins import split_between_fingers
from numpy.typing import NDArray

from crux_simulation.sim.judge import contact_forces_w
from crux_simulation.sim.recorder import Truth

Floats = NDArray[np.float64]


def grip_margins(truth: Truth, plan: Any, robot: RobotModel) -> Floats:
    """(n, 4, 2): the share of what a pad can bear, mu fz, that is left beside sqrt(shear^2 + (twist/k)^2).

    0 where it slips, less where the other pad takes some of its twist; NaN where not both of a limb's pads press a hold
    with what counts as contact, and on walls with faces that lean. `robot` has the faces as they are. The hands' own
    inertia is left out.
    """
    n = len(truth.cycle)
    face, normal_N = truth.pad_face.reshape(n, 4, 2), truth.pad_force_n.reshape(n, 4, 2)
    pressed = (normal_N >= robot.robot.control.contact_force_N) & (face >= 0) & (robot.face_hold[face] >= 0)
    if any(any(hold.lean_rad) for hold in plan.holds):
        return np.full((n, 4, 2), np.nan)  # faces that lean are not in these statics
    normal = _normals(truth, face, robot)
    out = np.stack([normal, -normal], axis=2)  # of both pads' faces
    centre_m = truth.pad_position_m.reshape(n, 4, 2, 3) - truth.gripper_position_m[:, :, None]
    at_m = centre_m - robot.robot.gripper.pad_radius_m * out
    pull_N = plan.spine_shear_n * robot.adhesion_of_face[face]
    across = (normal_N - pull_N)[..., None] * out
    force = contact_forces_w(truth, plan, robot.model.body_subtreemass[robot.gripper_bodies])
    moment = np.einsum("nlij,nlj->nli", truth.gripper_rotation, truth.hand_wrench_g[:, :, 3:])
    moment = moment - np.cross(_hand_arms(truth, robot), np.array(plan.gravity_w_m_s2))
    along = force - (force * normal).sum(axis=-1, keepdims=True) * normal
    rest = moment - np.cross(at_m, across).sum(axis=2) - np.cross(at_m.mean(axis=2), along)
    arm_m = at_m[:, :, 0] - at_m[:, :, 1]
    half_m = 0.5 * (arm_m * normal).sum(axis=-1)
    shear, _ = split_between_fingers(along, rest, normal, half_m, np.zeros((n, 4)))
    rest = rest - np.cross(arm_m, 0.5 * (shear[:, :, 0] - shear[:, :, 1]))
    twist = 0.5 * (rest * normal).sum(axis=-1)[..., None]
    friction, share = (np.array([getattr(each, key) for each in robot.faces])[face] for key in ("friction", "share"))
    demand_N = np.sqrt((shear**2).sum(axis=-1) + (twist / (share * plan.patch_k_m)) ** 2)
    return np.asarray(1.0 - demand_N / np.where(pressed.all(axis=2, keepdims=True), friction * normal_N, np.nan))


def _normals(truth: Truth, face: NDArray[np.int64], robot: RobotModel) -> Floats:
    """(n, 4, 3): of the face under finger 1, frame W; what the opening axis is nearest to."""
    data = mujoco.MjData(robot.model)
    mujoco.mj_forward(robot.model, data)
    geoms = np.array([robot.model.geom(each.geom).id for each in robot.faces])
    sides = data.geom_xmat.reshape(-1, 3, 3)[geoms][face[:, :, 0], :, :2]  # (n, 4, 3, x or y of the hold)
    along = np.einsum("nli,nlij->nlj", truth.gripper_rotation[..., 0], sides)
    best = np.abs(along).argmax(axis=-1)[..., None]
    side = np.take_along_axis(sides, best[:, :, None], axis=-1)[..., 0]
    return np.asarray(np.sign(np.take_along_axis(along, best, axis=-1)) * side)


def _hand_arms(truth: Truth, robot: RobotModel) -> Floats:
    """(n, 4, 3) [kg m]: each hand's mass times the way from the gripper's centre to its centre of mass, frame W."""
    model, data = robot.model, mujoco.MjData(robot.model)
    mujoco.mj_forward(model, data)
    bodies, sites = robot.gripper_bodies, robot.gripper_sites
    away, to_g = data.subtree_com[bodies] - data.site_xpos[sites], data.site_xmat[sites].reshape(-1, 3, 3)
    arms = model.body_subtreemass[bodies][:, None] * np.einsum("lji,lj->li", to_g, away)
    return np.asarray(np.einsum("nlij,lj->nli", truth.gripper_rotation, arms))
