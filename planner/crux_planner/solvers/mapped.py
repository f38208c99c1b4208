"""casadi's functions at many places at once, between numpy's arrays without a copy."""

from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array


class Mapped:
    """A function of casadi's symbols at many places at once, its common parts worked out once; reads and writes
    numpy's memory.
    """

    def __init__(self, name: str, arguments: list[Any], outputs: Any) -> None:
        dense = [ca.densify(output) for output in outputs]
        self.function = function = ca.Function(name, arguments, dense, {"cse": True})
        self._shapes = [function.size_out(i) for i in range(function.n_out())]
        self._at: dict[int, tuple[Any, Any]] = {}  # by number of places

    def __call__(self, *arguments: Array) -> Any:
        """At every row of the arguments (n, size): outputs (n, rows), or (n, rows, columns) of a matrix."""
        n = len(arguments[0])
        if n not in self._at:
            self._at[n] = self.function.map(n).buffer()
        buffer, run = self._at[n]
        given = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        found = [np.empty((n, columns, rows)) for rows, columns in self._shapes]
        for i, argument in enumerate(given):
            buffer.set_arg(i, argument.data)
        for i, values in enumerate(found):
            buffer.set_res(i, values.data)
        run()
        return tuple(v[:, 0] if v.shape[1] == 1 else v.swapaxes(1, 2) for v in found)
