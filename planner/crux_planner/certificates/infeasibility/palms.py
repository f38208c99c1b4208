"""Pairs of grips that no two grippers hold at once: their palms would be in each other wherever on the faces they are.

The check asks for a clearance between all limbs, also while none of them moves.
"""

from __future__ import annotations

import itertools

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.contacts import Grip
from crux_planner.model.shapes import PalmShape
from crux_planner.swing.swing import palm_gap

CLEARANCE_M = 0.0025  # the check asks for 3 mm and forgives a little


def largest_gap(a: Grip, b: Grip, palm: PalmShape) -> float:
    """Most plan-view distance [m] of two palms: at the ends of the faces, for distance is convex in where they are."""
    ends = itertools.product((-1.0, 1.0), repeat=2)
    return max(palm_gap(_palm(a, x, palm), _palm(b, y, palm), palm.half_width) for x, y in ends)


def clashes(grips: list[Grip], palm: PalmShape | None) -> Flags:
    """(G, G) whether two grips exclude each other."""
    count = len(grips)
    result = np.zeros((count, count), dtype=bool)
    if palm is None:
        return result
    centres = np.array([g.contact.centre_w_m[:2] for g in grips]).reshape(count, 2)
    way = np.linalg.norm(centres[:, None] - centres, axis=2)
    near = way < 2 * np.hypot(palm.half_length, palm.half_width) + CLEARANCE_M
    for i, j in np.argwhere(np.triu(near, 1)):
        a, b = grips[i], grips[j]
        over = max(a.height_m[1] - b.height_m[0], b.height_m[1] - a.height_m[0])  # one palm above the other
        if a.contact.hold == b.contact.hold or over >= palm.height + CLEARANCE_M:
            continue
        result[i, j] = result[j, i] = largest_gap(a, b, palm) < CLEARANCE_M
    return result


def _palm(grip: Grip, share: float, palm: PalmShape) -> Array:
    contact = grip.contact
    x, y, _ = contact.centre_w_m + share * grip.aside_m * contact.tangent
    return np.array([[x, y, contact.yaw_rad, palm.half_length]])
