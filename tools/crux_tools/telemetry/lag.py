"""A first-order lag over a series of samples."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dtbtrs


def lagged(gain: float, values: np.ndarray, before: np.ndarray | float) -> np.ndarray:
    """y[k] = y[k - 1] + gain (values[k] - y[k - 1]), (n, ...) for values (n, ...); y[-1] is `before`, (...).

    A triangular system of two bands; scipy.signal, which has such filters, takes most of a second to import.
    """
    if len(values) == 0:
        return np.zeros(values.shape)
    bands = np.ones((2, len(values)))
    bands[1] = gain - 1
    driven = gain * values.reshape(len(values), -1)
    driven[0] += (1 - gain) * np.broadcast_to(before, values.shape[1:]).ravel()
    smooth, _ = dtbtrs(bands, driven, uplo="L", diag="U")
    return np.asarray(smooth).reshape(values.shape)
