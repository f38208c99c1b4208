"""Where the planner's compiled parts are, and arrays as C has them."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int64, c_uint8
from pathlib import Path
from typing import Any

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices

_PACKAGES = Path(__file__).resolve().parents[2]
_FOLDERS = (
    _PACKAGES.parent / "build" / "cmake" / "planner",  # of a checkout
    _PACKAGES / "crux_tools" / "programs",  # of the wheel
    _PACKAGES.parent,  # of the Debian package
)


def shared_library(name: str) -> ctypes.CDLL | None:
    """None where it has not been built."""
    found = next((folder / name for folder in _FOLDERS if (folder / name).exists()), None)
    return None if found is None else ctypes.CDLL(str(found))


def doubles(values: Array) -> Any:
    """A pointer to a contiguous array of floats, which has to be kept."""
    assert values.dtype == np.float64
    assert values.flags.c_contiguous
    return ctypes.cast(values.ctypes.data, POINTER(c_double))


def integers(values: Indices) -> Any:
    """A pointer to a contiguous array of 64-bit integers, which has to be kept."""
    assert values.dtype == np.int64
    assert values.flags.c_contiguous
    return ctypes.cast(values.ctypes.data, POINTER(c_int64))


def flags(values: Flags) -> Any:
    """A pointer to a contiguous array of flags, which has to be kept."""
    assert values.flags.c_contiguous
    return ctypes.cast(values.ctypes.data, POINTER(c_uint8))
