"""The shipped robot with limbs of another geometry: one change each to its URDF, as other makers' limbs have them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from crux_contracts import LIMB_NAMES
from crux_contracts.robot import ROBOTS

SHOULDER = ("joint2", 'xyz="0 0 0"', 'xyz="0.01 0 0"')
WRIST = ("joint5", 'xyz="0 0 0"', 'xyz="0.02 0 0"')
GRIPPER = ("mount", 'xyz="0 0 -0.12"', 'xyz="0.03 0 -0.12"')
TILTED = ("joint1", 'rpy="0 0', 'rpy="0.1 0')
LIMITS = ("joint1", 'lower="-1.9"', 'lower="-1.5"')
LEFT, RIGHT = ("joint6", 'upper="2.9"', 'upper="0.6"'), ("joint6", 'lower="-2.9"', 'lower="-0.6"')
LONGER = ("joint4", 'xyz="0.2 0 0"', 'xyz="0.21 0 0"')
CHANGES: dict[str, list[tuple[Iterable[str], tuple[str, str, str]]]] = {
    "shoulder offset": [(LIMB_NAMES, SHOULDER)],
    "wrist offset": [(LIMB_NAMES, WRIST)],
    "gripper offset": [(LIMB_NAMES, GRIPPER)],
    "tilted mounts": [(LIMB_NAMES, TILTED)],
    "one limb's limits": [(["RF"], LIMITS)],
    "one longer limb": [(["LR"], LONGER)],
    "hands that turn one way": [(["LF", "LR"], LEFT), (["RF", "RR"], RIGHT)],
    "all of them": [(LIMB_NAMES, each) for each in (SHOULDER, WRIST, GRIPPER)] + [(["RF"], LIMITS)],
}


def other_limbs(change: str, folder: Path) -> Path:
    """A robot's folder in `folder`."""
    robot = folder / "scaler"
    shutil.copytree(ROBOTS / "scaler", robot)
    urdf = robot / "scaler.urdf"
    text = urdf.read_text(encoding="utf-8")
    for limbs, (joint, old, new) in CHANGES[change]:
        for limb in limbs:
            text = _in_joint(text, f"{limb}_{joint}", old, new)
    urdf.write_text(text, encoding="utf-8")
    return robot


def _in_joint(text: str, name: str, old: str, new: str) -> str:
    found = re.search(rf'<joint name="{name}".*?</joint>', text, re.DOTALL)
    assert found is not None
    after = found[0].replace(old, new, 1)
    assert after != found[0], name
    return text[: found.start()] + after + text[found.end() :]
