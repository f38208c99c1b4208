"""Grips that limbs cannot hold with the body at the goal, each by itself or all at once, where the boxes of `goal_map`
are too coarse to say so: branch and prune over poses within the goal's tolerances (planner/native/refute.h).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, c_double, c_int64, c_uint8
from functools import cache
from typing import Any

import numpy as np
from crux_contracts.compiled import flags

from crux_planner.certificates.infeasibility.poses import GoalPoses
from crux_planner.model.arrays import Flags
from crux_planner.model.contacts import Grip
from crux_planner.reach import native
from crux_planner.reach.arm import ArmReach
from crux_planner.reach.protocol import Reach

LOOKS = 100_000  # at a limb on a grip, and at two, in a box of poses, for one question


class _Goal(ctypes.Structure):
    """crux_refute_goal."""

    _fields_ = [
        *((name, c_double * 6) for name in ("low", "high", "middle")),
        ("rates", c_double * 9),
        *((name, c_double) for name in ("place_m", "turn_rad")),
    ]


class _Grip(ctypes.Structure):
    """crux_refute_grip."""

    _fields_ = [
        ("limb", c_int64),
        ("arm", POINTER(native.Arm)),
        *((name, c_double) for name in ("last_middle_rad", "cos_last_half")),
        *((name, c_double * 2) for name in ("centre_m", "tangent")),
        ("aside_m", c_double),
        ("height_m", c_double * 2),
        ("yaw_rad", c_double),
    ]


@cache
def _refute() -> Any:
    """None where it has not been built."""
    loaded = native.library()
    if loaded is None:
        return None
    loaded.crux_refute.restype = c_int64
    loaded.crux_refute.argtypes = [
        POINTER(_Goal),
        POINTER(_Grip),
        c_int64,
        POINTER(c_uint8),
        c_double,
        c_int64,
        c_double,
    ]
    return loaded.crux_refute


def cannot(
    poses: GoalPoses,
    reaches: Sequence[Reach],
    held: Sequence[tuple[int, Grip]],
    together: Flags | None = None,
    clear_m: float = 0.0,
    looks: int = LOOKS,
    seconds: float = np.inf,
) -> bool | None:
    """Whether no pose at the goal lets every limb that is named in `held` hold one of its grips there, fingers either
    way round: joint limits, links in the trunk, or nearer to another limb's than `clear_m`. Of two limbs only pairs are
    asked about that `together` (n, n) allows; None: all.

    True is certain. False: there is such a pose, or nothing can be shown, as for limbs without a closed form and where
    the compiled part is missing. None: `looks`, or so many seconds, were not enough.
    """
    limbs = {limb: reach for limb, _ in held if isinstance(reach := reaches[limb], ArmReach)}
    if _refute() is None or any(limb not in limbs for limb, _ in held):
        return False
    grips = [_grip(limb, limbs[limb], grip) for limb, grip in held]
    allowed = np.ones((len(held), len(held)), dtype=bool) if together is None else np.ascontiguousarray(together)
    asked = _goal(poses), (_Grip * len(grips))(*grips), len(grips), flags(allowed)
    return {1: True, 0: False}.get(_refute()(*asked, clear_m, looks, seconds))


def _goal(poses: GoalPoses) -> _Goal:
    low, high = poses.box()
    middle = np.concatenate([poses.goal.body.position_m, poses.goal.body.rpy_rad[[2, 0, 1]]])
    return _Goal(*map(native.numbers, (low, high, middle, poses.rates)), poses.place_m, poses.angle_rad)


def _grip(limb: int, arm: ArmReach, grip: Grip) -> _Grip:
    contact, (low, high) = grip.contact, arm.last_rad
    return _Grip(
        limb,
        ctypes.pointer(arm.outer),
        (low + high) / 2,
        np.cos(min((high - low) / 2, np.pi)),
        *map(native.numbers, (contact.centre_h_m[:2], contact.tangent[:2])),
        grip.aside_m,
        native.numbers(np.array(grip.height_m)),
        contact.yaw_rad,
    )
