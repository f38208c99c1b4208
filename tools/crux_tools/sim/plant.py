"""The simulated robot on its wall as the firmware sees it: torques in, encoder and force/torque readings out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from crux_tools.sim.robot_model import RobotModel
from crux_tools.sim.screw_friction import ScrewFriction
from crux_tools.sim.start_pose import rotation_from_rpy, take_start_pose

# Steps between two looks at the contacts, and the first one: in lockstep the runtime's cycles 1, 6, 11 …, among which
# are the cycles whose limbs it logs.
CONTACT_PERIOD, FIRST_CONTACT_STEP = 5, 2
# A hand carries the body until the nodes and the runtime stand: a stiff spring that lets go smoothly.
HAND_STIFFNESS_N_M = 1e5
HAND_STIFFNESS_NM_RAD = 1e3
HAND_DAMPING_NS_M = 2e3
HAND_DAMPING_NMS_RAD = 40.0
HAND_LETS_GO_S = (0.5, 1.5)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def smoothstep(x: float) -> float:
    """3x^2 - 2x^3 with x clipped to [0, 1]."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


class Plant:
    """Physics of one climb, stepped once a control cycle. The same seed and inputs give the same bits.

    Sensors are overwritten in place by every step: joint_position_rad, joint_velocity_rad_s, joint_torque_nm (24,),
    finger_opening_m, finger_speed_m_s, finger_force_n (4,), ft (24,): per limb the force [N] and moment [Nm] of the
    world on the gripper about its centre, gripper frame, raw: with the hand's weight, bias and noise.
    """

    def __init__(self, robot: RobotModel, plan: Any, seed: int) -> None:
        self.robot = robot
        self.model = robot.model
        self.data = mujoco.MjData(robot.model)
        self._random = np.random.default_rng(seed)
        servo, ft = robot.robot.servo, robot.robot.force_torque
        self.dt_s = float(self.model.opt.timestep)
        self._torque_share = np.full(24, 1 - np.exp(-self.dt_s / servo.torque_time_constant_s))
        self._screws: ScrewFriction | None = None
        self._ft_noise = np.tile(np.repeat([ft.noise_N, ft.noise_Nm], 3), 4)
        self._ft_bias = self._random.normal(size=24) * np.tile(np.repeat([ft.bias_N, ft.bias_Nm], 3), 4)
        self.cycle = 0
        self.joint_position_rad = np.zeros(24)
        self.joint_velocity_rad_s = np.zeros(24)
        self.joint_torque_nm = np.zeros(24)
        self.finger_opening_m = np.zeros(4)
        self.finger_speed_m_s = np.zeros(4)
        self.finger_force_n = np.zeros(4)
        self.ft = np.zeros(24)
        self.ft_true = np.zeros(24)
        self.pad_force_n = np.zeros(8)
        self.pad_face = np.full(8, -1)
        self.link_contact_force_n = 0.0
        take_start_pose(robot, self.data, plan)
        self._hand_position = self.data.qpos[:3].copy()
        self._hand_rotation = rotation_from_rpy(plan.knots[0].body_rpy_rad)
        mujoco.mj_forward(self.model, self.data)
        self._look_at_contacts()
        self._read_sensors()

    @property
    def time_s(self) -> float:
        """Physics time since the robot was set on the wall."""
        return self.cycle * self.dt_s

    def drive(self, joints: Sequence[int], limbs: Sequence[int]) -> None:
        """From now on the torque of these joints (of 24) is that of a motor, without the lag that stands for one, and
        the finger force of these limbs is that of a motor before its screw's friction."""
        self._torque_share[list(joints)] = 1.0
        self._screws = ScrewFriction(self.robot, limbs, self.robot.robot.gripper_motor) if limbs else None

    def step(self, joint_torque_nm: Floats, finger_force_n: Floats) -> None:
        """One control cycle: motor torques (24,) in joint direction, squeeze a finger (4,), positive closes."""
        control = self.data.ctrl
        self.joint_torque_nm += self._torque_share * (joint_torque_nm - self.joint_torque_nm)
        control[self.robot.joint_actuators] = self.joint_torque_nm
        push_n = np.repeat(finger_force_n[:, None], 2, axis=1)
        if self._screws is not None:
            limbs = self._screws.limbs
            push_n[limbs] += self._screws.set(self.pad_force_n.reshape(4, 2)[limbs])
        control[self.robot.finger_actuators] = -push_n
        self.finger_force_n[:] = finger_force_n
        self._carry()
        mujoco.mj_step(self.model, self.data)
        self.cycle += 1
        if self._screws is not None or self.cycle % CONTACT_PERIOD == FIRST_CONTACT_STEP:
            self._look_at_contacts()
        self._read_sensors()

    def limbs_on_holds(self) -> NDArray[np.bool_]:
        """(4,) whether both pads of a limb touch a hold (point feet: one the wall) at the last look."""
        if self.robot.point_feet:
            return np.asarray((self.pad_face >= 0).reshape(4, 2).any(axis=1))
        on_hold = (self.pad_face >= 0) & (self.robot.face_hold[self.pad_face] >= 0)
        return np.asarray(on_hold.reshape(4, 2).all(axis=1))

    def _carry(self) -> None:
        start, end = HAND_LETS_GO_S
        if self.time_s > end + self.dt_s:
            return
        share = 1 - smoothstep((self.time_s - start) / (end - start))
        data = self.data
        push = data.xfrc_applied[self.robot.body]
        push[:3] = share * HAND_STIFFNESS_N_M * (self._hand_position - data.qpos[:3])
        turn = self._hand_rotation @ data.xmat[self.robot.body].reshape(3, 3).T
        axis = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        push[3:] = share * HAND_STIFFNESS_NM_RAD * axis
        self.model.dof_damping[:3] = share * HAND_DAMPING_NS_M
        self.model.dof_damping[3:6] = share * HAND_DAMPING_NMS_RAD

    def _read_sensors(self) -> None:
        robot, data = self.robot, self.data
        np.take(data.qpos, robot.joint_qpos, out=self.joint_position_rad)
        np.take(data.qvel, robot.joint_dof, out=self.joint_velocity_rad_s)
        self.finger_opening_m[:] = data.qpos[robot.finger_qpos].mean(axis=1)
        self.finger_speed_m_s[:] = data.qvel[robot.finger_dof].mean(axis=1)
        # MuJoCo reports what the link exerts on the hand; wanted is what the world exerts on it.
        np.negative(data.sensordata[robot.ft_sensors], out=self.ft_true)
        np.multiply(self._ft_noise, self._random.standard_normal(24), out=self.ft)
        self.ft += self.ft_true
        self.ft += self._ft_bias

    def _look_at_contacts(self) -> None:
        """Which face each pad touches and how hard; sets the spines' pull accordingly."""
        robot, data = self.robot, self.data
        self.pad_force_n[:] = 0
        self.pad_face[:] = -1
        self.link_contact_force_n = 0.0
        if data.ncon:
            geoms = data.contact.geom
            pad = np.maximum(robot.pad_of_geom[geoms[:, 0]], robot.pad_of_geom[geoms[:, 1]])
            face = np.maximum(robot.face_of_geom[geoms[:, 0]], robot.face_of_geom[geoms[:, 1]])
            address = data.contact.efc_address
            force = np.where(address >= 0, data.efc_force[address], 0.0)  # first row of a contact: along the normal
            for p, f, n in zip(pad.tolist(), face.tolist(), force.tolist(), strict=True):
                if p < 0:
                    self.link_contact_force_n = max(self.link_contact_force_n, n)
                elif self.pad_face[p] < 0 or n > self.pad_force_n[p]:
                    self.pad_face[p], self.pad_force_n[p] = f, n
        if len(robot.spine_actuators):
            data.ctrl[robot.spine_actuators] = np.where(self.pad_face >= 0, robot.adhesion_of_face[self.pad_face], 0.0)
