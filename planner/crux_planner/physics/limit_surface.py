"""Equations (1)-(4): what a two-finger gripper can carry by friction and micro-spines.

By (4) both fingers of a gripper share its shear and its twist, and so does this module: (s1, s2) is the shear of ONE
finger, m the twist of ONE finger, and both fingers obey the same limit with the smaller friction of their two faces.
"""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array

# Inner polytope of the unit ball: |x|_inf <= 0.8 and |x|_1 <= 1.4. Its farthest vertices, (0.8, 0.6, 0) and its kin,
# have norm 1, so every point of it satisfies (2).
INFINITY_BOUND, ONE_BOUND = 0.8, 1.4

# sqrt(|x|^2 + SMOOTHING^2) replaces |x| in the cone: smooth at its apex, and inside the exact cone [N].
SMOOTHING_N = 0.05


def polytope_directions(k_m: float) -> tuple[Array, Array, Array]:
    """Rows of an inner polytope of the sum (1) of (2) and (3): G (26, 3), reach (26,), spine (26, 3).

    A finger with normal force n carries (s1, s2, m) if G @ (s1, s2, m) <= reach mu n + spine @ (shear, shear, twist),
    the last being its spines' limits (3). Each direction adds its support over the spine box, which makes the sum
    exact: the facets of a sum with a box stand on these directions and the box's own axes.
    """
    signs = np.array([g for g in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(g)])
    reach = np.where(np.abs(signs).sum(axis=1) == 1, INFINITY_BOUND, ONE_BOUND)
    scale = np.array([1.0, 1.0, 1.0 / k_m])
    return signs * scale, reach, np.abs(signs) * scale


def paper_directions(k_m: float) -> tuple[Array, Array]:
    """Rows of the paper's stand-in (11) for (2): G (10, 3), reach (10,), G @ (s1, s2, m) <= reach mu n.

    |s| + |m| / k <= mu n is four linear rows an axis: the binary gamma of (12) for the sign of m is not needed. It
    lets s1 = s2 = mu n pass, which (2) does not.
    """
    signs = np.array(
        [[a * (axis == 0), a * (axis == 1), b] for axis in (0, 1) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
        + [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    )
    return signs * np.array([1.0, 1.0, 1.0 / k_m]), np.ones(len(signs))


def surface_slack(variant: str, wrench: Any, spine_share: Any, loads: Any, k_m: float) -> Any:
    """What must not be negative [N] for a gripper's two fingers, with loads mu n each (casadi).

    `variant`: `cone` is (2), `inner` its inscribed polytope, `paper` (11).
    """
    if variant == "cone":
        return loads - cone_demand(wrench, spine_share, k_m)
    directions, reach = polytope_directions(k_m)[:2] if variant == "inner" else paper_directions(k_m)
    demand = ca.mtimes(ca.DM(directions), wrench - spine_share)
    return ca.vertcat(*[ca.DM(reach) * loads[finger] - demand for finger in (0, 1)])


def cone_demand(wrench: Any, spine_share: Any, k_m: float) -> Any:
    """Normal force times friction [N] that (2) asks of each finger, smoothed from above (casadi).

    `wrench` (s1, s2, m) is a finger's load, `spine_share` (a1, a2, am) the part its spines carry within (3).
    """
    rest = wrench - spine_share
    return ca.sqrt(rest[0] ** 2 + rest[1] ** 2 + (rest[2] / k_m) ** 2 + SMOOTHING_N**2)


def finger_forces(q: Array, normal_w: Array, tangent_w: Array) -> tuple[Array, Array]:
    """Forces (..., 2, 3) and moments on the robot of finger 1 (at +e) and 2 (at -e) for q = (s1, s2, m, n1, n2).

    `normal_w` (..., 3) is e, the outward normal of finger 1's face; the shear axes are `tangent_w` and W's z.
    """
    s1, s2, twist, n1, n2 = np.moveaxis(np.asarray(q)[..., None], -2, 0)
    shear = s1 * tangent_w + s2 * np.array([0.0, 0.0, 1.0])
    forces = np.stack([n1 * normal_w + shear, -n2 * normal_w + shear], axis=-2)
    return forces, np.stack([twist * normal_w] * 2, axis=-2)


def finger_inputs(force_w: Array, moment_w: Array, yaw_rad: Array) -> Array:
    """q = (s1, s2, m, n1, n2), shape (..., 5), of fingers' forces and moments (..., 2, 3): `finger_forces` undone.

    `yaw_rad` (...) is that of the gripper: its opening axis e is at this angle from the frame's x.
    """
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    first, second = force_w[..., 0, :], force_w[..., 1, :]
    shear = c * first[..., 1] - s * first[..., 0]
    twist = c * moment_w[..., 0, 0] + s * moment_w[..., 0, 1]
    press = [sign * (c * f[..., 0] + s * f[..., 1]) for sign, f in ((1.0, first), (-1.0, second))]
    return np.stack([shear, first[..., 2], twist, *press], axis=-1)
