"""One pad on one face: what a finger bears before it slips, apart from the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from crux_tools.robot3d.robot_model import add_pad_contacts, add_spines, set_solver_options
from crux_tools.robot3d.wall import Face

STEP_S = 0.002
MASS_KG, INERTIA_KG_M2 = 0.4, 1e-3


def pad_on_face(
    add_faces: Callable[[mujoco.MjSpec], list[Face]],
    at_W_m: Sequence[float],
    radius_m: float,
    patch_k_m: float,
    spine_shear_N: float = 0.0,
) -> mujoco.MjModel:
    """A puck at `at_W_m` (3,), free along W and about x, the normal of the face that it is to touch; no gravity."""
    spec = mujoco.MjSpec()
    set_solver_options(spec, STEP_S)
    spec.option.gravity = [0, 0, 0]
    faces = add_faces(spec)
    puck = spec.worldbody.add_body(name="puck", pos=at_W_m)
    for axis in np.eye(3):
        puck.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    puck.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1, 0, 0], damping=[1e-5, 0, 0])
    puck.mass, puck.inertia, puck.explicitinertial = MASS_KG, [INERTIA_KG_M2] * 3, True
    puck.add_geom(name="pad", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius_m, 0, 0], contype=0, conaffinity=0)
    add_pad_contacts(spec, ["pad"], faces, patch_k_m)
    if spine_shear_N > 0.0:
        add_spines(spec, "spines", "puck", spine_shear_N)
    return spec.compile()


def box_face(spec: mujoco.MjSpec, friction: float, half_m: float = 0.03) -> list[Face]:
    """A box about the origin, as the test object of the paper's section V-D."""
    spec.worldbody.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[half_m] * 3, contype=0, conaffinity=0)
    return [Face(0, "box", friction, spines=False)]


def slips_within(
    model: mujoco.MjModel, normal_N: float, shear_N: float, twist_Nm: float, ramp_s: float = 0.5, stand_s: float = 2.0
) -> bool:
    """Presses, ramps shear along y and twist about x up, and lets them stand; whether the pad moves 0.5 mm or 5 mrad.

    Creep of the contact model, 0.2 mm in that time, is none.
    """
    data = mujoco.MjData(model)
    ramp, stand = round(ramp_s / STEP_S), round(stand_s / STEP_S)
    for step in range(-ramp, ramp + stand):
        share = np.clip(step / ramp, 0.0, 1.0)
        data.qfrc_applied[:] = [-normal_N, share * shear_N, 0.0, share * twist_Nm]
        mujoco.mj_step(model, data)
        if step <= 0:
            start = data.qpos.copy()
    moved = data.qpos - start
    return bool(np.hypot(moved[1], moved[2]) > 5e-4 or abs(moved[3]) > 5e-3)
