"""Torque and heat of the actuators of joints in a climb against what the robot description says they bear."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.motors import joint_continuous_torque_Nm
from crux_contracts.robot import Robot
from crux_contracts.robot_types import of_slots

from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.lag import lagged
from crux_tools.telemetry.summary import CLIMBING


@dataclass(frozen=True)
class JointLoads:
    """Of a climb, (4, 6) each: limbs LF, RF, LR, RR, joints shoulder outwards; torques in Nm."""

    peak: np.ndarray
    rms: np.ndarray
    peak_limit: np.ndarray
    continuous_limit: np.ndarray  # of the winding, where the drive folds back the current
    advised: np.ndarray  # mean load that the makers of such servos advise
    heat: np.ndarray  # largest share of the bearable heat, the drive's I²t count from a cold start

    def rows(self) -> list[tuple[str, str]]:
        """A row a joint."""
        return [
            (
                f"{limb} joint{j + 1}",
                f"peak {self.peak[i, j]:.1f} of {self.peak_limit[i, j]:.1f} Nm, RMS {self.rms[i, j]:.1f} of "
                f"{self.continuous_limit[i, j]:.1f} Nm, heat at most {100 * self.heat[i, j]:.0f} %",
            )
            for i, limb in enumerate(LIMB_NAMES)
            for j in range(self.peak.shape[1])
        ]

    def notes(self) -> list[str]:
        """Limits that were passed, with every joint that did."""
        return [f"{what}: {', '.join(joints)}." for what, joints in self._passed()]

    def short_notes(self) -> list[str]:
        """Limits that were passed, with the joint that did by most."""
        return [
            f"{what}: {len(joints)} of {self.rms.size} joints, worst {joints[0]}" for what, joints in self._passed()
        ]

    def _passed(self) -> list[tuple[str, list[str]]]:
        """Limits with the joints that passed them, by how far."""
        passed = (
            ("Peak torque beyond the joint's effort", self.peak, self.peak_limit),
            ("RMS torque beyond what the winding bears for good", self.rms, self.continuous_limit),
            ("RMS torque beyond the mean load that makers of such servos advise", self.rms, self.advised),
        )
        found = []
        for what, torque, limit in passed:
            over = sorted(zip(*np.nonzero(torque > limit), strict=True), key=lambda at: -torque[at] / limit[at])
            if over:
                words = (f"{torque[i, j]:.1f} of {limit[i, j]:.1f} Nm" for i, j in over)
                names = (f"{LIMB_NAMES[i]} joint{j + 1}" for i, j in over)
                found.append((what, [f"{name} {word}" for name, word in zip(names, words, strict=True)]))
        return found


def heat_share(torque_Nm: np.ndarray, continuous_Nm: np.ndarray, heating_time_s: float, dt_s: float) -> np.ndarray:
    """Temperature rise of the windings as a share of what they bear, (n, ...) for torques (n, ...): a first-order lag
    of the torque's square, as firmware/core/drive/heat.c counts it, here from cold."""
    share = 1 - np.exp(-dt_s / heating_time_s)
    return lagged(share, (torque_Nm / continuous_Nm) ** 2, before=0.0)


def joint_torques_Nm(log: Telemetry) -> np.ndarray:
    """(n, 4, S) as the joints report them."""
    return np.asarray(log.inputs["joint_torque_nm"].reshape(len(log.time_s), len(LIMB_NAMES), -1))


def hot_nodes(log: Telemetry) -> list[str]:
    """Nodes that reported their temperature limit, or a thermometer that fails."""
    causes: dict[int, Any] = can_codec.message("JointEmergency", 1).get_signal_by_name("Cause").choices or {}
    bit = 1 << (next(int(value) for value, name in causes.items() if str(name) == "OVER_TEMPERATURE") - 1)
    joints = (log.inputs["joint_faults"].reshape(len(log.time_s), len(LIMB_NAMES), -1) & bit).any(axis=0)
    grippers = (log.inputs["gripper_faults"] & bit).any(axis=0)
    return [
        *(f"{LIMB_NAMES[i]} joint{j + 1}" for i, j in zip(*np.nonzero(joints), strict=True)),
        *(f"{LIMB_NAMES[i]} gripper" for i in np.flatnonzero(grippers)),
    ]


def joint_loads(log: Telemetry, robot: Robot) -> JointLoads:
    """Peaks and RMS while climbing (of a log that never climbs: of all cycles), heat over the whole log."""
    torque = joint_torques_Nm(log)
    climbing = log.state["supervisor_state"] == CLIMBING
    loaded = torque[climbing] if climbing.any() else torque
    efforts = [of_slots(limb.actuators.torque_Nm.tolist())[: robot.slots] for limb in robot.limbs]
    effort = np.array(efforts)
    continuous = np.minimum(joint_continuous_torque_Nm(robot.motor), effort)
    heat = heat_share(torque, continuous, robot.motor.heating_time_s, float(log.inputs["dt_s"][0]))
    return JointLoads(
        peak=np.abs(loaded).max(axis=0),
        rms=np.sqrt(np.mean(loaded**2, axis=0)),
        peak_limit=effort,
        continuous_limit=continuous,
        advised=np.broadcast_to(of_slots(robot.servo.continuous_torque_Nm)[: robot.slots], effort.shape),
        heat=heat.max(axis=0),
    )
