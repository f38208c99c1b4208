"""Body paths of least cost on static balance, by libcrux_path.so (planner/native/path.h says more)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Hashable, Sequence
from ctypes import POINTER, c_double, c_int, c_int64
from dataclasses import dataclass
from functools import cache

import numpy as np
from crux_contracts.compiled import doubles, integers, shared_library

from crux_planner.model.arrays import Array

NAME = "libcrux_path.so"
GRIP = 6  # numbers of a grip
_UNIT_N = 20.0  # of forces, about as large as a metre
_LEAST_STEP_M = 1e-7  # between nodes at one time, so that there is an inside


class _Grip(ctypes.Structure):
    """crux_path_grip."""

    _fields_ = [
        ("rows", c_int64),
        *((name, POINTER(c_double)) for name in ("limits", "right", "low", "high", "map", "effort")),
    ]


class _Problem(ctypes.Structure):
    """crux_path_problem."""

    _fields_ = [
        *((name, c_int64) for name in ("nodes", "directions")),
        *(
            (name, POINTER(c_double))
            for name in ("direction", "low", "high", "target", "pull", "speed", "step", "carried", "body", "weight")
        ),
        *((name, POINTER(c_int64)) for name in ("first", "on")),
    ]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built."""
    loaded = shared_library(NAME)
    if loaded is not None:
        loaded.crux_path_solve.restype = c_int
        loaded.crux_path_solve.argtypes = [POINTER(_Grip), POINTER(_Problem), POINTER(c_double), POINTER(c_double)]
    return loaded


@dataclass(frozen=True)
class Grip:
    """limits (rows, 6) @ q <= right (rows,), low <= q <= high (6,); its forces and moments are map (6, 6) @ q; effort
    (6,) . q^2 is what it costs.
    """

    limits: Array
    right: Array
    low: Array
    high: Array
    map: Array
    effort: Array


class Grips:
    """The grips of one problem, numbered as they are first asked for."""

    def __init__(self, make: Callable[[int], Grip]) -> None:
        self._make = make
        self._numbers: dict[Hashable, int] = {}
        self._kept: list[list[Array]] = []
        self._table: ctypes.Array[_Grip] = (_Grip * 0)()

    def numbers(self, contacts: Sequence[int]) -> list[int]:
        """Of the grips on contacts."""
        for contact in contacts:
            if contact not in self._numbers:
                self._numbers[contact] = len(self._kept)
                made = self._make(contact)
                ends = (each / _UNIT_N for each in (made.right, made.low, made.high))
                parts = (made.limits, *ends, made.map, made.effort)
                self._kept.append([np.ascontiguousarray(part, dtype=float) for part in parts])
        return [self._numbers[contact] for contact in contacts]

    @property
    def table(self) -> ctypes.Array[_Grip]:
        """As the compiled part has them."""
        if len(self._table) < len(self._kept):
            self._table = (_Grip * len(self._kept))(
                *(_Grip(len(parts[1]), *map(doubles, parts)) for parts in self._kept)
            )
        return self._table


@dataclass(frozen=True)
class PathProblem:
    """Places p (K, 3) between low and high (K, m) along directions (m, 3), the axes first; sum of pull[k] |p[k] -
    target|^2, speed[k] |p[k + 1] - p[k]|^2 and carried[k] times the efforts of the grips `on[k]`; |p[k + 1] - p[k]| <=
    step[k] along each axis; body[k] (6, 3) @ p[k] and what the grips do sum to weight[k] (6,).
    """

    directions: Array
    low: Array
    high: Array
    target: Array
    pull: Array
    speed: Array
    step: Array
    carried: Array
    body: Array
    weight: Array
    on: list[list[int]]


def least_cost(grips: Grips, problem: PathProblem) -> tuple[Array, Array] | None:
    """Places (K, 3) and q (G, 6) of all grips in order; None where none is found, or where the compiled part has
    not been built.
    """
    compiled = library()
    if compiled is None:
        return None
    nodes, on = len(problem.low), np.array([number for each in problem.on for number in each], dtype=np.int64)
    first = np.cumsum([0, *map(len, problem.on)], dtype=np.int64)
    step = np.append(np.maximum(problem.step, _LEAST_STEP_M), 0.0)
    floats = [
        problem.directions,
        problem.low,
        problem.high,
        problem.target,
        problem.pull,
        np.append(problem.speed, 0.0),
    ]
    floats += [step, _UNIT_N**2 * problem.carried, problem.body / _UNIT_N, problem.weight / _UNIT_N]
    kept = [np.ascontiguousarray(each, dtype=float) for each in floats]
    given = _Problem(nodes, len(problem.directions), *map(doubles, kept), integers(first), integers(on))
    places, wrenches = np.empty((nodes, 3)), np.empty((len(on), GRIP))
    if not compiled.crux_path_solve(grips.table, given, doubles(places), doubles(wrenches)):
        return None
    return places, _UNIT_N * wrenches
