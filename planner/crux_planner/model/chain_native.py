"""ctypes binding of libcrux_chain.so: inverse kinematics of chain.py, compiled (planner/native/chain.h says more)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int64, c_uint8
from functools import cache
from typing import Any

import numpy as np
from crux_contracts.compiled import doubles, flags, shared_library
from crux_contracts.robot_types import AtZero

from crux_planner.model.arrays import Array, Flags

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


class Lattice(ctypes.Structure):
    """crux_chain_lattice: it keeps its array alive."""

    _fields_ = [
        ("angles_rad", POINTER(c_double)),
        ("middle_m", c_double * 3),
        ("step_m", c_double),
        *((name, c_int64) for name in ("half", "turns")),
    ]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built: numpy gives the same answers."""
    loaded = shared_library(NAME)
    if loaded is not None:
        loaded.crux_chain_inverse.restype = None
        three = (POINTER(c_double),) * 3
        poses = (c_int64, *three, POINTER(c_uint8))
        loaded.crux_chain_inverse.argtypes = [POINTER(Chain), *poses]
        loaded.crux_chain_found.restype = loaded.crux_chain_back.restype = None
        loaded.crux_chain_found.argtypes = [POINTER(Chain), POINTER(Lattice), *poses]
        loaded.crux_chain_back.argtypes = [POINTER(Chain), c_int64, *three]
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


def lattice(angles_rad: Array, middle_m: Array, step_m: float) -> Lattice:
    """Postures (side, side, side, turns, S) about a place (3,)."""
    kept = np.ascontiguousarray(angles_rad, dtype=float)
    made = Lattice(doubles(kept), (c_double * 3)(*middle_m), step_m, kept.shape[0] // 2, kept.shape[3])
    made.kept = kept
    return made


def inverse(compiled: Any, limb: Chain, start: Array, places: Array, turns: Array) -> tuple[Array, Flags]:
    """Angles (n, S), and whether they have the poses (n, 3), (n, 3, 3) and are on the branch."""
    q, place, turn = (np.array(each, dtype=float, order="C") for each in (start, places, turns))
    reached = np.empty(len(q), dtype=np.bool_)
    compiled.crux_chain_inverse(limb, len(q), doubles(place), doubles(turn), doubles(q), flags(reached))
    return q, reached


def found(compiled: Any, limb: Chain, near: Lattice, places: Array, turns: Array) -> tuple[Array, Flags]:
    """The same from a lattice of postures."""
    place, turn = (np.ascontiguousarray(each, dtype=float) for each in (places, turns))
    q, reached = np.zeros((len(place), limb.slots)), np.empty(len(place), dtype=np.bool_)
    compiled.crux_chain_found(limb, near, len(q), doubles(place), doubles(turn), doubles(q), flags(reached))
    return q, reached


def back(compiled: Any, limb: Chain, q_rad: Array, damping: Array) -> Array:
    """Inverse Jacobians (n, S, 6) at angles (n, S), damped by so much (n,)."""
    q, by = (np.ascontiguousarray(each, dtype=float) for each in (q_rad, damping))
    made = np.empty((*q.shape, 6))
    compiled.crux_chain_back(limb, len(q), doubles(q), doubles(by), doubles(made))
    return made
