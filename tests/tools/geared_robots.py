"""The shipped robot with transmissions between its actuators and joints, its drives geared so that the joints are as
strong, stiff and heavy as before.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import yaml
from crux_contracts.robot import ROBOTS

RATIO = [-1.0, 2.0, 1.0, 1.0, -1.5, 0.8]
OFFSET_RAD = [0.3, -0.5, 0.2, 0.0, 0.1, -0.4]
GEARED: dict[str, Any] = {"ratio": RATIO, "offset_rad": OFFSET_RAD}
COUPLED = GEARED | {"coupled_to": [0, 0, 2, 0, 0, 0], "coupling": [0.0, 0.0, -0.6, 0.0, 0.0, 0.0]}
"""The elbow's actuator sits on the body and pulls a belt about the shoulder."""
FIVE_BAR = {
    "first_joint": 2, "crank_y_m": 0.038, "crank_m": 0.15, "rod_m": 0.188, "pin_x_m": 0.177, "pin_y_m": -0.046,
    "bends": -1, "least_sine": 0.2,
}  # fmt: skip
"""That of the makers' SCALER, a third larger."""
CRANKED: dict[str, Any] = {
    "ratio": [1.0, 1.0, -1.0, 1.0, 1.0, 1.0], "offset_rad": [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
    "torque_Nm": [12.0, 24.0, 24.0, 6.0, 6.0, 6.0], "speed_rad_s": [4.8] * 6,
}  # fmt: skip
_POWERS = {
    "position_gain_Nm_rad": 2, "velocity_gain_Nms_rad": 2, "armature_kg_m2": 2, "damping_Nms_rad": 2,
    "continuous_torque_Nm": 1,
}  # fmt: skip


def with_five_bars(folder: Path) -> Path:
    """A robot's folder in `folder`, five-bars at its shoulders and elbows."""
    robot = with_transmissions(CRANKED, folder)
    with (robot / "robot.yaml").open("a", encoding="utf-8") as file:
        file.write(yaml.safe_dump({"five_bar": FIVE_BAR}))
    return robot


def with_transmissions(section: dict[str, Any], folder: Path) -> Path:
    """A robot's folder in `folder`."""
    robot = folder / "scaler"
    shutil.copytree(ROBOTS / "scaler", robot)
    text = (robot / "robot.yaml").read_text(encoding="utf-8")
    ratio = section.get("ratio", [1.0] * 6)
    servo = yaml.safe_load(text)["servo"]
    for key, power in _POWERS.items():
        numbers = [value / abs(r) ** power for value, r in zip(servo[key], ratio, strict=True)]
        text, changed = re.subn(rf"{key}: \[.*?\]", f"{key}: {numbers}", text)
        assert changed == 1
    (robot / "robot.yaml").write_text(f"{text}\n{yaml.safe_dump({'transmissions': section})}", encoding="utf-8")
    return robot
