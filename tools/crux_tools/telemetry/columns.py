"""The numbers of a record array one by one, by names that say which joint, limb or axis each is of."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from crux_contracts import LIMB_NAMES, robot_bounds

XYZ = ("x", "y", "z")
JOINTS = {
    len(LIMB_NAMES) * slots: [f"{limb}_joint{joint + 1}" for limb in LIMB_NAMES for joint in range(slots)]
    for slots in (robot_bounds.JOINTS, robot_bounds.MOST_JOINTS)
}
FINGERS = [f"{limb}_finger{finger}" for limb in LIMB_NAMES for finger in (1, 2)]
WXYZ = ("w", *XYZ)
LABELS = {3: XYZ, 4: LIMB_NAMES, **JOINTS, 8: FINGERS, 12: [f"{limb}_{axis}" for limb in LIMB_NAMES for axis in XYZ]}


def _labels(field: str, count: int) -> list[str]:
    """What the numbers of an array are called."""
    if "quaternion" in field:
        return list(WXYZ) if count == 4 else [f"{limb}_{part}" for limb in LIMB_NAMES for part in WXYZ]
    if field.startswith("pad_position"):
        return [f"{finger}_{axis}" for finger in FINGERS for axis in XYZ]
    return list(LABELS.get(count) or map(str, range(count)))


def columns(table: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Names and values of the columns of a record array."""
    for field in table.dtype.names or ():
        values = table[field]
        if values.ndim == 1:
            yield field, values
        else:
            labels = _labels(field, values.shape[1])
            yield from ((f"{field}_{label}", values[:, i]) for i, label in enumerate(labels))
