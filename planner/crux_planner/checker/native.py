"""ctypes binding of libcrux_checker.so (planner/native/inverse_kinematics.h and box_distance.h say more)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int64
from functools import cache

from crux_contracts.compiled import needed_library

NAME = "libcrux_checker.so"


class Arm(ctypes.Structure):
    """crux_arm."""

    _fields_ = [
        *((name, c_int64) for name in ("joints", "spares")),
        *((name, POINTER(c_double)) for name in ("turns", "offsets_m", "middle_rad", "spare")),
    ]


@cache
def library() -> ctypes.CDLL:
    """FileNotFoundError where it has not been built."""
    loaded = needed_library(NAME)
    floats = POINTER(c_double)
    taking = {
        "arm_place": [POINTER(Arm), c_int64, *[floats] * 4],
        "arm_reach": [POINTER(Arm), c_int64, *[floats] * 4],
        "segment_to_box": [c_int64, *[floats] * 4],
    }
    for name, types in taking.items():
        function = getattr(loaded, f"crux_{name}")
        function.restype, function.argtypes = None, types
    return loaded
