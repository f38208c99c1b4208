"""Five-bars of a robot in MuJoCo: a crank with a hinge of its own, and a rod without mass, which is a tendon of a fixed
length from the crank's end to the pin. What the rod weighs belongs into the URDF's links.
"""

from __future__ import annotations

import mujoco
import numpy as np
from crux_contracts.five_bar import FiveBar
from crux_contracts.robot import Limb, Robot
from numpy.typing import NDArray

ROD_SOLREF = (0.005, 1.0)
ROD_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
NO_MASS_KG, NO_INERTIA_KG_M2 = 1e-6, 1e-9  # of a crank: its rotor is what turns

Floats = NDArray[np.float64]


def crank_name(limb: Limb) -> str:
    """Of the crank's hinge."""
    return f"{limb.name}/crank"


def driven_names(robot: Robot) -> dict[str, str]:
    """Hinges that actuators turn in place of joints, by the joints' names."""
    bars = [(limb, limb.transmission.five_bar) for limb in robot.limbs]
    return {limb.joint_names[bar.first + 1]: crank_name(limb) for limb, bar in bars if bar is not None}


def add_linkages(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Of all limbs; the cranks' hinges have no inertia, friction or actuator yet."""
    for limb in robot.limbs:
        if (bar := limb.transmission.five_bar) is not None:
            _add_linkage(spec, limb, bar)


def _add_linkage(spec: mujoco.MjSpec, limb: Limb, bar: FiveBar) -> None:
    name, keys, at_zero = crank_name(limb), bar.section, limb.at_zero
    joints = [spec.joint(limb.joint_names[j]) for j in (bar.first, bar.first + 1)]
    (axis, _), (start, end) = at_zero.axes[bar.first : bar.first + 2], at_zero.points_m[bar.first : bar.first + 2]
    aside = axis * (axis @ (end - start))
    x = (end - start - aside) / bar.link_m
    plane = np.stack([x, np.cross(axis, x), axis], axis=1)
    middle = start + aside + plane[:, :2] @ [keys.crank_x_m, keys.crank_y_m]
    link = joints[0].parent
    turn = _rotation(link.quat) @ at_zero.rotations[bar.first].T  # link before the first joint <- body
    crank = link.parent.add_body(
        name=name, pos=link.pos + turn @ (middle - start), quat=_quaternion(turn @ plane), mass=NO_MASS_KG,
        inertia=[NO_INERTIA_KG_M2] * 3, ipos=[0] * 3, explicitinertial=True,
    )  # fmt: skip
    crank.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    crank.add_site(name=f"{name}/end", pos=[keys.crank_m, 0, 0])
    pin = plane[:, :2] @ [keys.pin_x_m, keys.pin_y_m]
    joints[1].parent.add_site(name=f"{name}/pin", pos=at_zero.rotations[bar.first + 1].T @ pin)
    rod = spec.add_tendon(name=f"{name}/rod", width=0.004)
    rod.wrap_site(f"{name}/end")
    rod.wrap_site(f"{name}/pin")
    at_zero_m = np.hypot(bar.link_m + keys.pin_x_m - keys.crank_x_m - keys.crank_m, keys.pin_y_m - keys.crank_y_m)
    fixed = spec.add_equality(type=mujoco.mjtEq.mjEQ_TENDON, name1=f"{name}/rod")
    fixed.objtype = mujoco.mjtObj.mjOBJ_TENDON
    fixed.data[:5] = [keys.rod_m - at_zero_m, 0, 0, 0, 0]
    fixed.solref, fixed.solimp = ROD_SOLREF, ROD_SOLIMP


def close_linkages(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Turns the cranks to where the joints of `data` have them."""
    for limb in robot.limbs:
        if (bar := limb.transmission.five_bar) is not None:
            joints = [model.joint(limb.joint_names[j]).qposadr[0] for j in (bar.first, bar.first + 1)]
            data.qpos[model.joint(crank_name(limb)).qposadr[0]] = bar.crank_rad(data.qpos[joints])


def _rotation(quaternion: Floats) -> Floats:
    found = np.empty(9)
    mujoco.mju_quat2Mat(found, quaternion)
    return found.reshape(3, 3)


def _quaternion(rotation: Floats) -> Floats:
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, rotation.ravel())
    return found
