"""casadi's functions as lists of instructions, which libcrux_tape.so runs at many places at once (planner/native/tape.h
says more), in a fraction of the time that casadi takes.
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int, c_int32, c_int64, c_void_p
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Self

import casadi as ca
import numpy as np
from crux_contracts.compiled import doubles, shared_library
from numpy.typing import NDArray

from crux_planner.model.arrays import Array, Indices

NAME = "libcrux_tape.so"
_OPERATIONS = {
    ca.OP_INPUT: None,
    ca.OP_OUTPUT: None,
    ca.OP_CONST: None,
    ca.OP_ASSIGN: np.positive,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: lambda x: 2.0 * x,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
}  # in the order of tape.h; by numpy where that has not been built
_NUMBERS = {operation: number for number, operation in enumerate(_OPERATIONS)}
_INPUT, _OUTPUT, _CONSTANT = range(3)
_BY_NUMPY = list(_OPERATIONS.values())
_TWO = {_NUMBERS[each] for each in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_ATAN2)}  # of two numbers


class _Tape(ctypes.Structure):
    """crux_tape."""

    _fields_ = [
        *((name, c_int64) for name in ("instructions", "work")),
        *((name, POINTER(c_int32)) for name in ("operation", "to", "first", "second")),
        ("constant", POINTER(c_double)),
    ]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built: numpy gives the same answers."""
    loaded = shared_library(NAME)
    if loaded is not None:
        addresses, sizes = POINTER(c_void_p), POINTER(c_int64)
        loaded.crux_tape_run.restype = c_int
        loaded.crux_tape_run.argtypes = [POINTER(_Tape), c_int64, addresses, sizes, addresses, sizes]
    return loaded


@dataclass(frozen=True)
class Tape:
    """Of K instructions: operations, where they write, their operands (4, K), and constants (K,); how many numbers they
    work on, the sizes of arguments and the shapes (n, 2) of results.
    """

    code: NDArray[np.int32]
    constant: Array
    work: int
    sizes: Indices
    shapes: Indices

    @classmethod
    def of(cls, function: ca.Function) -> Self:
        """Of a function of SX with dense results. ValueError for one with other operations than those above."""
        code = np.zeros((4, function.n_instructions()), dtype=np.int32)
        constant = np.zeros(code.shape[1])
        for k in range(code.shape[1]):
            operation = function.instruction_id(k)
            if operation not in _NUMBERS:
                raise ValueError(f"{function.name()}: operation {operation} of instruction {k}: expected one of tape.h")
            number, operands, to = _NUMBERS[operation], function.instruction_input(k), function.instruction_output(k)
            if number == _CONSTANT:
                constant[k] = function.instruction_constant(k)
            result, to = (to[0], to[1:]) if number == _OUTPUT else (None, to)
            operands = [*operands, result] if result is not None else operands or to
            code[:, k] = number, to[0], operands[0], operands[-1]
        shapes = np.array([function.size_out(i) for i in range(function.n_out())], dtype=np.int64)
        sizes = np.array([function.size1_in(i) for i in range(function.n_in())], dtype=np.int64)
        return cls(code, constant, int(function.sz_w()), sizes, shapes)

    def __call__(self, *arguments: Array) -> list[Array]:
        """Results (n, columns, rows) at arguments (n, size)."""
        n = len(arguments[0])
        given = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        if (wrong := [each.shape for each in given]) != [(n, size) for size in self.sizes.tolist()]:
            raise ValueError(f"arguments of shapes {wrong}: expected {n} rows of {self.sizes.tolist()}")
        found = [np.empty((n, columns, rows)) for rows, columns in self.shapes.tolist()]
        compiled = library()
        if compiled is None:
            self._by_numpy(given, found)
            return found
        tape, sizes, ends = self._compiled
        ok = compiled.crux_tape_run(tape, n, _addresses(given), sizes, _addresses(found), ends)
        assert ok
        return found

    @cached_property
    def _compiled(self) -> tuple[_Tape, Any, Any]:
        """As the compiled part has it, with the sizes of arguments and results."""
        lists = (ctypes.cast(part.ctypes.data, POINTER(c_int32)) for part in self.code)
        sizes, ends = (
            (c_int64 * len(each))(*each) for each in (self.sizes.tolist(), self.shapes.prod(axis=1).tolist())
        )
        return _Tape(self.code.shape[1], self.work, *lists, doubles(self.constant)), sizes, ends

    def _by_numpy(self, given: list[Array], found: list[Array]) -> None:
        work: list[Any] = [np.zeros(len(given[0]))] * self.work
        flat = [each.reshape(len(each), -1) for each in found]
        for (operation, to, first, second), constant in zip(self.code.T.tolist(), self.constant.tolist(), strict=True):
            if operation == _INPUT:
                work[to] = given[first][:, second]
            elif operation == _OUTPUT:
                flat[second][:, to] = work[first]
            elif operation == _CONSTANT:
                work[to] = constant
            else:
                both = (work[first], work[second]) if operation in _TWO else (work[first],)
                work[to] = _BY_NUMPY[operation](*both)


def _addresses(arrays: list[Array]) -> Any:
    return (c_void_p * len(arrays))(*(each.__array_interface__["data"][0] for each in arrays))
