"""Where the planner's compiled parts are, and arrays as C has them."""

from __future__ import annotations

import ctypes
import errno
from ctypes import POINTER, c_double, c_int64, c_uint8
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PACKAGES = Path(__file__).resolve().parents[1]
_FOLDERS = (
    _PACKAGES.parents[1] / "build" / "cmake" / "planner",  # of a checkout
    _PACKAGES / "crux_tools" / "programs",  # of the wheel
    _PACKAGES.parent,  # of the Debian package
)


def shared_library(name: str) -> ctypes.CDLL | None:
    """None where it has not been built."""
    found = next((folder / name for folder in _FOLDERS if (folder / name).exists()), None)
    return None if found is None else ctypes.CDLL(str(found))


def needed_library(name: str) -> ctypes.CDLL:
    """FileNotFoundError where it has not been built."""
    loaded = shared_library(name)
    if loaded is None:
        raise FileNotFoundError(errno.ENOENT, "not built: build crux's programs first (make programs)", name)
    return loaded


def doubles(values: NDArray[np.float64]) -> Any:
    """A pointer to a contiguous array of floats, which has to be kept."""
    assert values.dtype == np.float64
    assert values.flags.c_contiguous
    return ctypes.cast(values.ctypes.data, POINTER(c_double))


def integers(values: NDArray[np.int64]) -> Any:
    """A pointer to a contiguous array of 64-bit integers, which has to be kept."""
    assert values.dtype == np.int64
    assert values.flags.c_contiguous
    return ctypes.cast(values.ctypes.data, POINTER(c_int64))


def flags(values: NDArray[np.bool_]) -> Any:
    """A pointer to a contiguous array of flags, which has to be kept."""
    assert values.flags.c_contiguous
    return ctypes.cast(values.ctypes.data, POINTER(c_uint8))
