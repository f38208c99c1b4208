"""The Python binding of LCM. It links to GLib, which a bare system lacks: the wheel brings GLib for that case."""

from __future__ import annotations

import contextlib
import ctypes

from crux_tools.paths import PROGRAMS

GLIB = "libglib-2.0.so.0"
for place in (GLIB, PROGRAMS / GLIB):  # the system's own first: what else loads it in this process may need a newer one
    with contextlib.suppress(OSError):
        ctypes.CDLL(str(place))
        break

import lcm  # noqa: E402

__all__ = ["lcm"]
