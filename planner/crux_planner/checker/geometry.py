"""Rotations and cuboids, vectorised over leading axes.

Where there are many, matrices and vectors lie in memory component by component: products are then written out, which
for thousands of small matrices is several times faster than stacked matrix products.
"""

import numpy as np
from crux_contracts.compiled import doubles
from numpy.typing import NDArray

from crux_planner.checker import native

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int_]


def rotation_from_rpy(rpy: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll), shape (..., 3) -> (..., 3, 3); turns W <- B."""
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(rpy), -1, 0), np.moveaxis(np.cos(rpy), -1, 0)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def rotation_about_z(angle: Array) -> Array:
    """Rz(angle), shape (...) -> (..., 3, 3)."""
    s, c = np.sin(angle), np.cos(angle)
    zero, one = np.zeros_like(s), np.ones_like(s)
    return np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]), (0, 1), (-2, -1))


def rotation_of_gripper(yaw: Array, tilt: Array) -> Array:
    """exp(tilt) Rz(yaw), shapes (...), (..., 2) -> (..., 3, 3): the tilt is a rotation vector about x and y, whose
    exponential is I + sin(a) / a S + (1 - cos(a)) / a^2 S^2 with S its cross product and a its length.
    """
    upright = rotation_about_z(yaw)
    if not tilt.any():
        return upright
    x, y, zero = tilt[..., 0], tilt[..., 1], np.zeros_like(tilt[..., 0])
    skew = np.moveaxis(np.array([[zero, zero, y], [zero, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))
    angle = np.hypot(x, y)[..., None, None]
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray((np.eye(3) + first * skew + second * skew @ skew) @ upright)


def turned(rotation: Array, vector: Array) -> Array:
    """R v, shapes (..., 3, 3), (..., 3) -> (..., 3)."""
    x, y, z = vector[..., 0, None], vector[..., 1, None], vector[..., 2, None]
    return np.asarray(rotation[..., :, 0] * x + rotation[..., :, 1] * y + rotation[..., :, 2] * z)


def turned_back(rotation: Array, vector: Array) -> Array:
    """R^T v, shapes (..., 3, 3), (..., 3) -> (..., 3)."""
    x, y, z = vector[..., 0, None], vector[..., 1, None], vector[..., 2, None]
    return np.asarray(rotation[..., 0, :] * x + rotation[..., 1, :] * y + rotation[..., 2, :] * z)


def turned_by(rotation: Array, constant: Array) -> Array:
    """R C, shapes (n, 3, 3), (3, 3) -> (n, 3, 3)."""
    return np.asarray(np.tensordot(constant.T, rotation.T, axes=1).T)


def about_z(columns: Array, sine: Array, cosine: Array) -> Array:
    """R Rz(angle), columns of rotations first (3, 3, n), for sines and cosines (n,)."""
    x, y, z = np.broadcast_arrays(*columns, sine)[:3]
    return np.array([cosine * x + sine * y, cosine * y - sine * x, z])


def cross(a: Array, b: Array) -> Array:
    """Cross products (3, ...) of vectors (3, ...): components first."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def solved(matrices: Array, right: Array) -> Array:
    """x (k, n) of A x = b for symmetric positive definite A (k, k, n), overwritten, and b (k, n), by A = L D L^T."""
    size, x = len(right), right.copy()
    for j in range(size - 1):
        below = matrices[j + 1 :, j] / matrices[j, j]
        matrices[j + 1 :, j + 1 :] -= below[:, None] * matrices[j, j + 1 :]
        x[j + 1 :] -= below * x[j]
    for j in range(size - 1, -1, -1):
        x[j] = (x[j] - (matrices[j, j + 1 :] * x[j + 1 :]).sum(axis=0)) / matrices[j, j]
    return x


def rotation_vector(rotation: Array) -> Array:
    """Logarithm of rotations (..., 3, 3) -> (..., 3); near a half turn the axis is taken from the symmetric part."""
    pairs = (2, 1), (0, 2), (1, 0)
    skew = 0.5 * np.stack([rotation[..., i, j] - rotation[..., j, i] for i, j in pairs], axis=-1)
    sine = np.linalg.norm(skew, axis=-1)
    cosine = np.clip(0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0), -1.0, 1.0)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, sine, 1.0), 1.0)
    vector = skew * scale[..., None]
    half_turn = (sine <= 1e-6) & (cosine < 0.0)
    if np.any(half_turn):
        axis = np.sqrt(np.clip(0.5 * (np.diagonal(rotation, axis1=-2, axis2=-1) + 1.0), 0.0, 1.0))
        vector = np.where(half_turn[..., None], np.pi * axis, vector)
    return vector


def body_rate_matrix(rpy: Array) -> Array:
    """E with omega_B = E(theta) theta_dot, shape (..., 3) -> (..., 3, 3)."""
    sr, cr = np.sin(rpy[..., 0]), np.cos(rpy[..., 0])
    sp, cp = np.sin(rpy[..., 1]), np.cos(rpy[..., 1])
    zero, one = np.zeros_like(sr), np.ones_like(sr)
    rows = [[one, zero, -sp], [zero, cr, sr * cp], [zero, -sr, cr * cp]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def signed_distance_to_box(points: Array, half_extents: Array) -> Array:
    """Signed distance (negative inside) of points (..., 3), given in the box's own centred frame, to the box."""
    beyond = np.abs(points) - half_extents
    x, y, z = beyond[..., 0], beyond[..., 1], beyond[..., 2]
    deepest = np.maximum(np.maximum(x, y), z)
    x, y, z = np.maximum(x, 0.0), np.maximum(y, 0.0), np.maximum(z, 0.0)
    return np.asarray(np.sqrt(x * x + y * y + z * z) + np.minimum(deepest, 0.0))


def segment_to_box(start: Array, end: Array, half_extents: Array) -> Array:
    """Least signed distance (n,) of segments (n, 3)-(n, 3) to a box in the box's frame, to 1e-5 of their length."""
    parts = [np.ascontiguousarray(np.broadcast_to(each, start.shape)) for each in (start, end, half_extents)]
    found = np.empty(len(start))
    native.library().crux_segment_to_box(len(start), *map(doubles, (*parts, found)))
    return found


def box_to_box(centre: Array, rotation: Array, half_a: Array, half_b: Array) -> Array:
    """Separation of box A (centre (..., 3), rotation (..., 3, 3), in B's centred frame) from box B, by the separating
    axis theorem over its 15 axes: the exact depth where they overlap, a lower bound of the distance where they don't.
    """
    axes_b = np.broadcast_to(np.eye(3), rotation.shape)
    axes_a = np.swapaxes(rotation, -1, -2)
    edges = np.cross(axes_a[..., :, None, :], axes_b[..., None, :, :]).reshape(*rotation.shape[:-2], 9, 3)
    length = np.linalg.norm(edges, axis=-1, keepdims=True)
    usable = length[..., 0] > 1e-6
    edges = edges / np.where(length > 1e-6, length, 1.0)
    axes = np.concatenate([axes_a, axes_b, edges], axis=-2)
    reach_a = np.abs(axes @ rotation) @ half_a
    reach_b = (np.abs(axes) @ np.broadcast_to(half_b, centre.shape)[..., None])[..., 0]
    gap = np.abs((axes @ centre[..., None])[..., 0]) - reach_a - reach_b
    gap[..., 6:] = np.where(usable, gap[..., 6:], -np.inf)
    return np.asarray(gap.max(axis=-1))


def segment_to_segment(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """Least distance (...) between segments a0-a1 and b0-b1, all (..., 3).

    The squared distance is a convex quadratic of the two parameters: its minimum over the unit square is the inner
    stationary point if that lies in the square, else the least over the four edges.
    """
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    determinant = uu * vv - uv * uv
    safe = determinant > 1e-12 * np.maximum(uu * vv, 1e-12)
    scale = np.where(safe, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / scale, (uu * vw - uv * uw) / scale
    inner = safe & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)

    def distance(s: Array, t: Array) -> Array:
        return np.asarray(np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1))

    def ratio(top: Array, bottom: Array) -> Array:
        return np.clip(top / np.where(bottom > 0.0, bottom, 1.0), 0.0, 1.0)

    zero, one = np.zeros_like(uu), np.ones_like(uu)
    edges = [
        distance(zero, ratio(vw, vv)),
        distance(one, ratio(vw + uv, vv)),
        distance(ratio(-uw, uu), zero),
        distance(ratio(uv - uw, uu), one),
    ]
    least = np.minimum.reduce(edges)
    return np.where(inner, np.minimum(least, distance(s, t)), least)
