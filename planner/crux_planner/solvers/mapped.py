"""casadi's functions at many places at once, between numpy's arrays without a copy."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model import kept
from crux_planner.model.arrays import Array

_MOST = 40  # functions kept, of a megabyte each
_PACKAGE = Path(__file__).resolve().parents[1]
_MADE: dict[Hashable, Mapped] = {}  # those of `once`
_MADE_BY = ("model", "physics", "reach", "solvers", "trajectory")  # folders of what functions are made of


class Mapped:
    """A function of casadi's symbols at many places at once, its common parts worked out once; reads and writes
    numpy's memory.
    """

    def __init__(self, name: str, arguments: list[Any], outputs: Any) -> None:
        dense = [ca.densify(output) for output in outputs]
        self._take(ca.Function(name, arguments, dense, {"cse": True}))

    @classmethod
    def once(cls, given: Hashable, make: Callable[[], Mapped]) -> Mapped:
        """What `make` returns, made once in this process for the same `given`: of those, the last `_MOST` are kept."""
        made = _MADE.pop(given, None) or make()
        _MADE[given] = made  # last
        while len(_MADE) > _MOST:
            del _MADE[next(iter(_MADE))]
        return made

    @classmethod
    def kept(cls, given: object, make: Callable[[], Mapped]) -> Mapped:
        """What `make` returns, from this computer's cache where it was made before by the same program of the same
        `given`, as its repr has it. Making a function takes five times as long as reading it.
        """

        def written() -> dict[str, Any]:
            return {"function": np.frombuffer(make().function.serialize().encode("latin-1"), dtype=np.uint8)}

        what = ca.CasadiMeta.version(), _source(), given
        found = kept.arrays((), what, written, below="functions", most=_MOST)["function"]
        mapped = cls.__new__(cls)
        mapped._take(ca.Function.deserialize(found.tobytes().decode("latin-1")))
        return mapped

    def _take(self, function: ca.Function) -> None:
        self.function = function
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


@cache
def _source() -> str:
    """Digest of all that functions may be made by."""
    files = sorted(file for folder in _MADE_BY for file in (_PACKAGE / folder).glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
