"""A controller for tests only: joints hold their pose by PD with the feed-forward of statics, fingers squeeze."""

from __future__ import annotations

import mujoco
import numpy as np
from crux_simulation.sim.plant import Plant
from numpy.typing import NDArray

RAMP_S = 0.2


class HoldingController:
    """Knows the model and its state without the sensors' errors; each limb carries itself and, with `carries_body`, a
    quarter of the whole weight."""

    def __init__(self, plant: Plant, squeeze_n: float = 20.0, *, carries_body: bool = True) -> None:
        self.plant = plant
        self.carries_body = carries_body
        self.squeeze_n = squeeze_n
        servo = plant.robot.robot.servo
        self.stiffness = np.tile(servo.position_gain_Nm_rad, 4)
        self.damping = np.tile(servo.velocity_gain_Nms_rad, 4)
        self.wanted_rad = plant.data.qpos[plant.robot.joint_qpos].copy()
        self._jacobian = np.zeros((6, plant.model.nv))

    def _feed_forward(self) -> NDArray[np.float64]:
        plant, robot = self.plant, self.plant.robot
        torque = plant.data.qfrc_bias[robot.joint_dof].copy()
        if not self.carries_body:
            return np.asarray(torque)
        share = -plant.model.body_subtreemass[robot.body] * plant.model.opt.gravity / 4
        for limb in range(4):
            mujoco.mj_jacSite(
                plant.model, plant.data, self._jacobian[:3], self._jacobian[3:], robot.gripper_sites[limb]
            )
            dofs = robot.joint_dof[6 * limb : 6 * limb + 6]
            torque[6 * limb : 6 * limb + 6] -= self._jacobian[:3, dofs].T @ share
        return np.asarray(torque)

    def command(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Torques (24,) and finger forces (4,) for the plant as it is."""
        plant = self.plant
        squeeze = self.squeeze_n * min(1.0, plant.time_s / RAMP_S)
        torque = self.stiffness * (self.wanted_rad - plant.data.qpos[plant.robot.joint_qpos])
        torque += self._feed_forward() - self.damping * plant.data.qvel[plant.robot.joint_dof]
        return torque, np.full(4, squeeze)

    def run(self, seconds: float) -> None:
        """Steps the plant."""
        for _ in range(round(seconds / self.plant.dt_s)):
            self.plant.step(*self.command())
