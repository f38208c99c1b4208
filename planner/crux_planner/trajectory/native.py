"""ctypes binding of libcrux_stages.so (planner/native/stage_system.h says more)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int, c_int64
from functools import cache

import numpy as np
from crux_contracts.compiled import doubles, needed_library

from crux_planner.model.arrays import Array

NAME = "libcrux_stages.so"


class _Stages(ctypes.Structure):
    """crux_stages."""

    _fields_ = [
        ("knots", c_int64),
        *(
            (name, POINTER(c_double))
            for name in ("state_hessian", "column_hessian", "cross", "state_map", "into_state")
        ),
    ]


@cache
def library() -> ctypes.CDLL:
    """FileNotFoundError where it has not been built."""
    loaded = needed_library(NAME)
    floats = POINTER(c_double)
    loaded.crux_stage_factors.restype, loaded.crux_stage_factors.argtypes = c_int64, []
    loaded.crux_stage_factor.restype, loaded.crux_stage_factor.argtypes = c_int, [POINTER(_Stages), floats]
    loaded.crux_stage_solve.restype = None
    loaded.crux_stage_solve.argtypes = [POINTER(_Stages), *[floats] * 7]
    return loaded


class StageSystem:
    """Factors of a chain of knots, each with four columns: Hessians by states (N + 1, 12, 12), columns (N, 4, 8, 8) and
    both (N, 4, 12, 8), and what states (N, 12, 12) and columns (N, 4, 12, 8) do to the next states. Of a column the
    first five numbers act on the body. LinAlgError where a column's Hessian is singular.
    """

    def __init__(self, states: Array, columns: Array, cross: Array, state_map: Array, into_state: Array) -> None:
        self._kept = [np.ascontiguousarray(each) for each in (states, columns, cross, state_map, into_state)]
        self._stages = _Stages(len(state_map), *map(doubles, self._kept))
        self._factors = np.empty((len(state_map), library().crux_stage_factors()))
        if not library().crux_stage_factor(self._stages, doubles(self._factors)):
            raise np.linalg.LinAlgError("a column's Hessian is singular")

    def solve(self, state_slope: Array, column_slope: Array, defects: Array) -> tuple[Array, Array, Array]:
        """Steps of states (N + 1, 12), the first 0, and columns (N, 4, 8), and multipliers (N, 12) of the dynamics, for
        slopes of the same shapes and what the dynamics lack (N, 12).
        """
        given = [np.ascontiguousarray(each) for each in (state_slope, column_slope, defects)]
        found = np.empty_like(given[0]), np.empty_like(given[1]), np.empty_like(given[2])
        library().crux_stage_solve(self._stages, doubles(self._factors), *map(doubles, (*given, *found)))
        return found
