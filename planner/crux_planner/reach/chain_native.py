"""ctypes binding of libcrux_chain.so: maps and links of chain_reach.py, compiled (planner/native/chain.h says more)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int64, c_uint8
from functools import cache
from typing import Any

import numpy as np
from crux_contracts.compiled import doubles, flags
from crux_contracts.robot import Limb

from crux_planner.model import chain_native
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.chain import ChainInverse
from crux_planner.reach.native import ANY_SIDE, Box, Capsule, Poses, given, numbers
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import LINK_OF, Solids

_GRIPPER = -1  # frame of what is on it


class ChainLimb(ctypes.Structure):
    """crux_chain_limb: it keeps its arrays alive."""

    _fields_ = [
        ("chain", chain_native.Chain),
        ("lattice", chain_native.Lattice),
        *((name, POINTER(c_double)) for name in ("lower_rad", "upper_rad", "margin_rad", "rotations")),
        ("clear_m", c_double),
        ("trunk", POINTER(Box)),
        ("links", POINTER(Capsule)),
        *((name, c_int64) for name in ("boxes", "capsules", "all_capsules")),
    ]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built: numpy gives the same answers."""
    loaded = chain_native.library()
    if loaded is not None:
        loaded.crux_chain_reaches.restype = loaded.crux_chain_links.restype = None
        loaded.crux_chain_reaches.argtypes = [POINTER(ChainLimb), POINTER(Poses), POINTER(c_uint8)]
        loaded.crux_chain_links.argtypes = [POINTER(ChainLimb), POINTER(Poses), POINTER(c_double), POINTER(c_double)]
    return loaded


def chain_limb(limb: Limb, inverse: ChainInverse, margin_rad: float, keep_off: Solids, clear_m: float) -> ChainLimb:
    """A limb whose joints keep off their limits by a margin, its links off the trunk by a clearance."""
    margins = np.where(np.arange(len(limb.lower_rad)) < len(limb.joints), margin_rad, 0.0)
    zero = limb.at_zero
    given_arrays = limb.lower_rad, limb.upper_rad, margins, zero.rotations[: len(margins)]
    arrays = [np.ascontiguousarray(each, dtype=float) for each in given_arrays]
    boxes = [Box(numbers(b.centre_m), numbers(b.rotation), numbers(b.half_m)) for b in keep_off.trunk]
    shapes = (*keep_off.links, *keep_off.first)
    frames = [LINK_OF.get(shape.frame, _GRIPPER) for shape in shapes]
    capsules = [
        Capsule(numbers(c.start_m), numbers(c.end_m), c.radius_m, frame)
        for c, frame in zip(shapes, frames, strict=True)
    ]
    made = ChainLimb(
        inverse.compiled,
        inverse.compiled_lattice,
        *map(doubles, arrays),
        clear_m,
        (Box * len(boxes))(*boxes),
        (Capsule * len(capsules))(*capsules),
        len(boxes),
        len(keep_off.links),
        len(capsules),
    )
    made.kept = arrays, inverse
    return made


def reaches(compiled: Any, limb: ChainLimb, poses: GripperPoses) -> Flags:
    """Which poses, of up to six axes, are reached."""
    seen, whole, _kept = given(poses, ANY_SIDE)
    found = np.empty(whole, dtype=np.bool_)
    compiled.crux_chain_reaches(limb, seen, flags(found))
    return found.reshape(poses.shape)


def links(compiled: Any, limb: ChainLimb, poses: GripperPoses) -> tuple[Array, Array]:
    """Both ends (..., P, 3) of all capsules at poses of up to six axes, in the body frame."""
    seen, whole, _kept = given(poses, ANY_SIDE)
    start, end = (np.empty((*whole, limb.all_capsules, 3)) for _ in range(2))
    compiled.crux_chain_links(limb, seen, doubles(start), doubles(end))
    shape = *poses.shape, limb.all_capsules, 3
    return start.reshape(shape), end.reshape(shape)
