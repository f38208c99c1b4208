"""Equations (1)-(4): what a two-finger gripper can carry by friction and micro-spines.

By (4) both fingers of a gripper share its shear and its twist, and so does this module: (s1, s2) is the shear of ONE
finger, m the twist of ONE finger. Each finger i has a limit of its own: (s1, s2, m) lies in the unit ball of (2) times
mu_i n_i, friction of its face and its normal force, plus the box (3) of its spines. So faces that differ need no more
unknowns. What spines bear of a load is one share a for both: the best is the point of the box nearest to the load,
whatever the friction; a finger without spines has to bear all of the load by friction.

In balance only F = n1 - n2 counts besides (s1, s2, m), and a squeeze n with it. Where both fingers have the same limits
n is the smaller normal force, whose finger bounds (s1, s2, m) for both. Where they differ n is the mean of the normal
forces, n1 = n + F / 2 and n2 = n - F / 2, and each finger bounds (s1, s2, m).

On a face that leans, these are a finger's force along and across the opening axis, which (4) is about: the face has a
frame of its own, whose normal lies between the axis and the way off the wall (`in_face`).
"""

import itertools
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array

# Inner polytope of the unit ball: |x|_inf <= 0.8 and |x|_1 <= 1.4. Its farthest vertices, (0.8, 0.6, 0) and its kin,
# have norm 1, so every point of it satisfies (2).
INFINITY_BOUND, ONE_BOUND = 0.8, 1.4

# sqrt(|x|^2 + SMOOTHING^2) replaces |x| in the cone: smooth at its apex, and inside the exact cone [N].
SMOOTHING_N = 0.05


def polytope_directions(k_m: float) -> tuple[Array, Array]:
    """Rows of an inner polytope of the sum (1) of (2) and (3): G (26, 3), reach (26,).

    A finger with normal force n carries (s1, s2, m) if G @ (s1, s2, m) <= reach mu n + |G| @ spines, the last being
    what its spines hold of (s1, s2, m) by (3). Each direction adds its support over the spine box, which makes the sum
    exact: the facets of a sum with a box stand on these directions and the box's own axes.
    """
    signs = np.array([g for g in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(g)])
    reach = np.where(np.abs(signs).sum(axis=1) == 1, INFINITY_BOUND, ONE_BOUND)
    scale = np.array([1.0, 1.0, 1.0 / k_m])
    return signs * scale, reach


class FingerLimit(NamedTuple):
    """What bounds (s1, s2, m) in balance: a finger with normal force n + side F / 2; `side` 0: both alike."""

    side: int
    friction: float
    spines: Array  # (3,) most of (s1, s2, m) that they hold
    lean_rad: float = 0.0


_UPRIGHT = np.zeros(2)
_Z = np.array([0.0, 0.0, 1.0])


def finger_limits(friction: Array, spines: Array, lean_rad: Array = _UPRIGHT) -> list[FingerLimit]:
    """The limits of a grip whose fingers have friction (2,), spines (2, 3) and faces that lean (2,): one where both
    have the same, upright.
    """
    if friction[0] == friction[1] and (spines[0] == spines[1]).all() and not lean_rad.any():
        return [FingerLimit(0, float(friction[0]), spines[0])]
    of_finger = zip((1, -1), friction, spines, lean_rad, strict=True)
    return [FingerLimit(side, float(mu), box, float(lean)) for side, mu, box, lean in of_finger]


def in_face(lift: Any, press: Any, cosine: Any, sine: Any) -> tuple[Any, Any]:
    """(s2, n) in the frame of a face that leans: `lift` is a finger's force off the wall, `press` along the axis."""
    return cosine * lift - sine * press, cosine * press + sine * lift


_UNITS = ((1.0, 0.0), (0.0, 1.0))  # of lift, and of press


def grip_rows(
    limits: list[FingerLimit], directions: Array, reach: Array, most_N: Array, foot: bool = False
) -> tuple[Array, Array]:
    """(A, b), A @ (s1, s2, m, F, n) <= b of a grip: limit surface, and normal forces up to `most_N` (2,) a finger, of a
    foot up to the least of these in all.

    `directions` and `reach` are those of a polytope; n >= 0 is left to the caller.
    """
    rows, right = [], []
    for side, friction, spines, lean_rad in limits:
        load = friction * reach[:, None]
        if lean_rad:
            (up, pressed), (sunk, press) = (in_face(*each, np.cos(lean_rad), np.sin(lean_rad)) for each in _UNITS)
            lift = up * directions[:, 1:2] - pressed * load
            along = sunk * directions[:, 1:2] - press * load
            rows.append(np.hstack([directions[:, :1], lift, directions[:, 2:], side / 2 * along, along]))
        else:
            rows.append(np.hstack([directions, -side / 2 * load, -load]))
        right.append(np.abs(directions) @ spines)
    each = np.array([[0.0, 0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, -1.0, 1.0]])
    if foot:
        return np.vstack([*rows, [0.0, 2.0, 0.0, 0.0, 0.0]]), np.concatenate([*right, [most_N.min()]])
    if len(limits) == 1:
        return np.vstack([*rows, each]), np.concatenate([*right, most_N])
    each[:, 3] /= 2
    return np.vstack([*rows, each, -each]), np.concatenate([*right, most_N, np.zeros(2)])


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


def surface_slack(variant: str, wrench: Any, spine_share: Any, load: Any, k_m: float) -> Any:
    """What must not be negative [N] for a finger with load mu n (casadi).

    `variant`: `cone` is (2), `inner` its inscribed polytope, `paper` (11).
    """
    if variant == "cone":
        return load - cone_demand(wrench, spine_share, k_m)
    directions, reach = polytope_directions(k_m) if variant == "inner" else paper_directions(k_m)
    return ca.DM(reach) * load - ca.mtimes(ca.DM(directions), wrench - spine_share)


def cone_demand(wrench: Any, spine_share: Any, k_m: float) -> Any:
    """Normal force times friction [N] that (2) asks of each finger, smoothed from above (casadi).

    `wrench` (s1, s2, m) is a finger's load, `spine_share` (a1, a2, am) the part its spines carry within (3).
    """
    rest = wrench - spine_share
    return ca.sqrt(rest[0] ** 2 + rest[1] ** 2 + (rest[2] / k_m) ** 2 + SMOOTHING_N**2)


def finger_forces(
    q: Array, normal_h: Array, tangent_h: Array, leaning_h: tuple[Array, Array] | None = None, up_h: Array = _Z
) -> tuple[Array, Array]:
    """Forces (..., 2, 3) and moments on the robot of finger 1 (at +e) and 2 (at -e) for q = (s1, s2, m, n1, n2).

    `normal_h` (..., 3) is e, the outward normal of finger 1's face; the shear axes are `tangent_h` and `up_h`. Moments
    are about the pads' faces on the axis. Where some faces lean, `leaning_h` are their normals (..., 2, 3), and where
    the pads touch, off the axis, (..., 2, 3).
    """
    s1, s2, twist, n1, n2 = np.moveaxis(np.asarray(q)[..., None], -2, 0)
    shear = s1 * tangent_h + s2 * up_h
    forces = np.stack([n1 * normal_h + shear, -n2 * normal_h + shear], axis=-2)
    if leaning_h is None:
        return forces, np.stack([twist * normal_h] * 2, axis=-2)
    faces_h, touch_h = leaning_h
    return forces, twist[..., None] * faces_h * np.array([[1.0], [-1.0]]) + np.cross(touch_h, forces)


def finger_inputs(
    force_h: Array,
    moment_h: Array,
    normal_h: Array,
    tangent_h: Array,
    leaning_h: tuple[Array, Array] | None = None,
    up_h: Array = _Z,
) -> Array:
    """q = (s1, s2, m, n1, n2), shape (..., 5), of fingers' forces and moments (..., 2, 3): `finger_forces` undone."""
    faces_h, first = normal_h, force_h[..., 0, :]
    twisting = moment_h[..., 0, :]
    if leaning_h is not None:
        faces_h, twisting = leaning_h[0][..., 0, :], twisting - np.cross(leaning_h[1][..., 0, :], first)
    presses = first, -force_h[..., 1, :]
    parts = [(first, tangent_h), (first, up_h), (twisting, faces_h), *((press, normal_h) for press in presses)]
    return np.stack([(part * along).sum(axis=-1) for part, along in parts], axis=-1)
