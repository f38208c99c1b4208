"""casadi's functions at many places at once, between numpy's arrays without a copy."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca

from crux_planner.model import kept
from crux_planner.model.arrays import Array
from crux_planner.solvers.tape import Tape

_MOST = 40  # functions kept, of a megabyte each
_PACKAGE = Path(__file__).resolve().parents[1]
_MADE: dict[Hashable, Mapped] = {}  # those of `once`
_MADE_BY = ("model", "physics", "reach", "search", "solvers", "trajectory")  # folders of what functions are made of


class Mapped:
    """A function of casadi's symbols at many places at once, its common parts worked out once; reads and writes
    numpy's memory.
    """

    def __init__(self, name: str, arguments: list[Any], outputs: Any) -> None:
        dense = [ca.densify(output) for output in outputs]
        self.function = ca.Function(name, arguments, dense, {"cse": True})
        self.tape = Tape.of(self.function)

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
        what = ca.CasadiMeta.version(), _source(), given
        found = kept.arrays((), what, lambda: asdict(make().tape), below="functions", most=_MOST)
        mapped = cls.__new__(cls)
        mapped.tape = Tape(**found)
        return mapped

    def __call__(self, *arguments: Array) -> Any:
        """At every row of the arguments (n, size): outputs (n, rows), or (n, rows, columns) of a matrix."""
        found = self.tape(*arguments)
        return tuple(v[:, 0] if v.shape[1] == 1 else v.swapaxes(1, 2) for v in found)


@cache
def _source() -> str:
    """Digest of all that functions may be made by."""
    files = sorted(file for folder in _MADE_BY for file in (_PACKAGE / folder).glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
