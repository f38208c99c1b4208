"""ctypes binding of libcrux_chain.so: inverse kinematics of chain.py, compiled (planner/native/chain.h says more)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int64, c_uint8
from functools import cache
from typing import Any

import numpy as np
from crux_contracts.robot_types import AtZero

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.native import doubles, shared_library

NAME = "libcrux_chain.so"


class Chain(ctypes.Structure):
    """crux_chain: it keeps its arrays alive."""

    _fields_ = [
        *((name, POINTER(c_double)) for name in ("axes", "points_m")),
        ("gripper_m", c_double * 3),
        ("rotation", c_double * 9),
        *((name, POINTER(c_double)) for name in ("rule", "middle_rad")),
        *((name, c_double) for name in ("sign", "close", "damping", "largest_rad")),
        *((name, c_int64) for name in ("slots", "iterations")),
    ]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built: numpy gives the same answers."""
    loaded = shared_library(NAME)
    if loaded is not None:
        loaded.crux_chain_inverse.restype = None
        three = [POINTER(c_double)] * 3
        loaded.crux_chain_inverse.argtypes = [POINTER(Chain), c_int64, *three, POINTER(c_uint8)]
    return loaded


def chain(zero: AtZero, rule: Array, middle_rad: Array, sign: float, numbers: tuple[float, float, float, int]) -> Chain:
    """A limb with what Newton's method goes by; `numbers` are close, damping, largest_rad and iterations."""
    *lengths, iterations = numbers
    arrays = [np.ascontiguousarray(each, dtype=float) for each in (zero.axes, zero.points_m, rule, middle_rad)]
    axes, points, rules, middle = map(doubles, arrays)
    place, turn = (c_double * 3)(*zero.gripper_m), (c_double * 9)(*zero.gripper_rotation.ravel())
    made = Chain(axes, points, place, turn, rules, middle, sign, *lengths, len(middle_rad), iterations)
    made.kept = arrays
    return made


def inverse(compiled: Any, limb: Chain, start: Array, places: Array, turns: Array) -> tuple[Array, Flags]:
    """Angles (n, S), and whether they have the poses (n, 3), (n, 3, 3) and are on the branch."""
    q, place, turn = (np.array(each, dtype=float, order="C") for each in (start, places, turns))
    reached = np.empty(len(q), dtype=np.bool_)
    at = reached.ctypes.data_as(POINTER(c_uint8))
    compiled.crux_chain_inverse(limb, len(q), doubles(place), doubles(turn), doubles(q), at)
    return q, reached
