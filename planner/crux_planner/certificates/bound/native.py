"""ctypes binding of libcrux_bound.so (timeline.h, stretched.h, centre_of_mass.h, knot_bounds.h of planner/native)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int32, c_int64
from functools import cache
from typing import Any

from crux_contracts import N_LIMBS
from crux_contracts.compiled import shared_library

NAME = "libcrux_bound.so"


class TimelineOptions(ctypes.Structure):
    """crux_timeline_options."""

    _fields_ = [("many", c_int64), ("ages", c_int64), ("least_air", POINTER(c_int64))]


class TimelineLimb(ctypes.Structure):
    """crux_timeline_limb."""

    _fields_ = [
        ("count", c_int64),
        *((name, POINTER(c_int32)) for name in ("standing", "lifted", "lands_from", "step", "landings")),
    ]


class Timeline(ctypes.Structure):
    """crux_timeline."""

    _fields_ = [
        *((name, c_int64) for name in ("states", "nodes")),
        *((name, POINTER(c_int32)) for name in ("younger", "older", "first")),
        ("change", c_double),
        ("limbs", TimelineLimb * N_LIMBS),
    ]


class StretchedLimb(ctypes.Structure):
    """crux_stretched_limb."""

    _fields_ = [
        ("options", c_int64),
        *((name, POINTER(c_double)) for name in ("least", "most", "shoulder", "squared_m")),
    ]


class MassTable(ctypes.Structure):
    """crux_mass_table."""

    _fields_ = [("cells", c_int64), *((name, POINTER(c_double)) for name in ("ends", "height"))]


class MassLimb(ctypes.Structure):
    """crux_mass_limb."""

    _fields_ = [
        ("tables", MassTable * 2),
        ("options", c_int64),
        *((name, POINTER(c_double)) for name in ("shoulder", "wide", "least", "most")),
    ]


class Masses(ctypes.Structure):
    """crux_masses."""

    _fields_ = [
        ("limbs", MassLimb * N_LIMBS),
        ("tilts", c_int64),
        *((name, POINTER(c_double)) for name in ("own", "cosine", "sine", "aside")),
        *((name, c_double) for name in ("cell_m", "shift_m", "mass_kg")),
    ]


class Accelerations(ctypes.Structure):
    """crux_knot_accelerations."""

    _fields_ = [("offset_m", c_double * 6), ("push_N", c_double), ("spin_Nm", c_double)]


class Knot(ctypes.Structure):
    """crux_knot: it keeps its arrays alive."""

    _fields_ = [
        ("accelerations", Accelerations),
        ("tilts", c_int64),
        *((name, POINTER(c_double)) for name in ("yaw_cost", "tilt_cost", "shift_m")),
        *((name, c_double * 3) for name in ("weight_N", "goal_m")),
        ("distance", c_double),
    ]


class KnotPairs(ctypes.Structure):
    """crux_knot_pairs."""

    _fields_ = [
        *((name, c_int64) for name in ("pairs", "one_multiplier", "one_rest")),
        *((name, POINTER(c_double)) for name in ("low", "high", "box", "follow", "rest", "multipliers")),
        ("cell", POINTER(c_int64)),
    ]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built."""
    loaded = shared_library(NAME)
    if loaded is not None:
        floats, whole = POINTER(c_double), POINTER(c_int64)
        taking = {
            "timeline_states": [POINTER(TimelineOptions), whole, POINTER(Timeline)],
            "timeline_forward": [POINTER(Timeline), *[floats] * 4],
            "timeline_backward": [POINTER(Timeline), *[floats] * 5],
            "stretched": [POINTER(StretchedLimb), c_double, c_double, c_int64, whole, whole, whole, floats, floats],
            "knot_most": [POINTER(Accelerations), c_int64, *[floats] * 4],
            "knot_least": [POINTER(Knot), POINTER(KnotPairs), floats],
            "mass_bounds": [POINTER(Masses), c_int64, floats, floats, whole, whole, whole, floats],
        }
        for name, types in taking.items():
            function = getattr(loaded, f"crux_{name}")
            function.restype, function.argtypes = None, types
    return loaded


def needed() -> ctypes.CDLL:
    """The library: no bound is worked out where it has not been built."""
    loaded = library()
    assert loaded is not None
    return loaded


def short_integers(values: Any) -> Any:
    """A pointer to a contiguous array of 32-bit integers, which has to be kept."""
    return ctypes.cast(values.ctypes.data, POINTER(c_int32))
