"""The slots that messages have for the joints of a limb, and those that a robot needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from crux_contracts import N_LIMBS
from crux_contracts.robot_bounds import JOINTS, MOST_JOINTS
from crux_contracts.yaml_document import DocumentError, parse_mapping

OF_MESSAGES = (N_LIMBS * MOST_JOINTS,)


def slots_of(files: dict[str, bytes]) -> int:
    """Of a limb, of the robot that a log carries (Robot.slots); six of one that carries none that can be read."""
    try:
        top: Any = parse_mapping(files.get("robot.yaml", b""), "robot.yaml").content
        joints = top["limb"].content["joints"].content
        return max(JOINTS, min(len(joints), MOST_JOINTS))
    except (DocumentError, KeyError, TypeError, AttributeError):
        return JOINTS


def of_robot(dtype: np.dtype, slots: int) -> np.dtype:
    """Of a message's records, with the robot's own slots of joints alone."""
    assert dtype.names is not None
    kinds = [(name, dtype[name]) for name in dtype.names]
    return np.dtype(
        [(name, (kind.base, (N_LIMBS * slots,)) if _is_of_joints(name, kind) else kind) for name, kind in kinds]
    )


def for_robot(table: np.ndarray, slots: int) -> np.ndarray:
    """Records (n,) of a message with the robot's own slots of joints alone; those of earlier logs are so already."""
    narrow = of_robot(table.dtype, slots)
    if narrow == table.dtype or slots == MOST_JOINTS:
        return table
    made = np.empty(table.shape, narrow)
    for name in narrow.names or ():
        values = table[name]
        if narrow[name] != table.dtype[name]:
            values = values.reshape(-1, N_LIMBS, MOST_JOINTS)[:, :, :slots].reshape(-1, N_LIMBS * slots)
        made[name] = values
    return made


def for_messages(values: Sequence[float]) -> list[float]:
    """What a log of an earlier format has of all joints, six a limb, as messages have it: a slot without a joint is as
    the limb's last joint is, with numbers 0.
    """
    limbs = [values[limb * JOINTS : (limb + 1) * JOINTS] for limb in range(N_LIMBS)]
    return [
        value
        for own in limbs
        for value in (*own, *[0.0 if isinstance(own[-1], float) else own[-1]] * (MOST_JOINTS - JOINTS))
    ]


def _is_of_joints(name: str, kind: np.dtype) -> bool:
    return name.startswith("joint_") and kind.shape == OF_MESSAGES
