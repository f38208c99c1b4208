"""The simulated robot on its wall as the firmware sees it: torques in, encoder and force/torque readings out.

The steps themselves are made in tools/sim/plant.cpp, on the model and data that Python shows.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from crux_tools.robot3d.robot_model import RobotModel
from crux_tools.robot3d.start_pose import take_start_pose
from crux_tools.telemetry.rotations import rotation_from_rpy
from numpy.typing import NDArray

from crux_simulation.sim.native import PlantMap, PlantSettings, PlantState, PlantWorld, library

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
DOUBLES = ctypes.POINTER(ctypes.c_double)
ENCODER_NOISE_TURNS = 0.068 / 360  # rms of a sample; magnetic encoders of 14 bits hover by 3 bits of them
IDLE_FRICTION_NM = 0.3
"""Of a joint's gear, turned from behind without power [A]; one that is driven has the friction of robot.yaml."""
ENCODER_NOISE_1_S = 112.0
"""Of the speed that a board observes, by the noise of a sample: sqrt(T w^3 / 4) of firmware/core/drive/encoder.h, whose
two poles are at w = 1000 rad/s, sampled each T = 50 us."""


def _fill(target: Any, values: Any) -> None:
    numbers = np.ravel(values).tolist()
    target[: len(numbers)] = numbers


class Plant:
    """Physics of one climb, stepped once a control cycle. The same seed and inputs give the same bits.

    Sensors are overwritten in place by every step: joint_position_rad, joint_velocity_rad_s, joint_torque_nm (4 S,) of
    the actuators,
    finger_opening_m, finger_speed_m_s, finger_force_n (4,), ft (24,): per limb the force [N] and moment [Nm] of the
    world on the gripper about its centre, gripper frame, raw: with the hand's weight, bias and noise; ft_true without
    the last two; pad_force_n, pad_face (8,) of the last look at the contacts.
    """

    def __init__(self, robot: RobotModel, plan: Any, seed: int, world: PlantWorld | None = None) -> None:
        """`plan` begins where the robot really stands; `world`: what else is not as described."""
        self.robot = robot
        self.model = robot.model
        self.data = mujoco.MjData(robot.model)
        self.dt_s = float(self.model.opt.timestep)
        take_start_pose(robot, self.data, plan)
        mujoco.mj_forward(self.model, self.data)
        settings = self._settings(seed, rotation_from_rpy(plan.knots[0].body_rpy_rad))
        self._native = library()
        self._state = PlantState()
        self._world = world  # the plant points into it
        self.handle = ctypes.c_void_p(
            self._native.crux_plant_open(
                self.model._address, self.data._address, self._map(), settings, world, self._state
            )
        )
        joints = slice(4 * robot.robot.slots)
        self.joint_position_rad = self._view("joint_position_rad")[joints]
        self.joint_velocity_rad_s = self._view("joint_velocity_rad_s")[joints]
        self.joint_torque_nm = self._view("joint_torque_nm")[joints]
        self.finger_opening_m = self._view("finger_opening_m")
        self.finger_speed_m_s = self._view("finger_speed_m_s")
        self.finger_force_n = self._view("finger_force_n")
        self.ft = self._view("ft")
        self.ft_true = self._view("ft_true")
        self.pad_force_n = self._view("pad_force_n")
        self.pad_face = self._view("pad_face")

    def __del__(self) -> None:
        if hasattr(self, "handle"):
            self._native.crux_plant_close(self.handle)

    def _settings(self, seed: int, hand_rotation: Floats) -> PlantSettings:
        robot = self.robot.robot
        servo, ft, motor = robot.servo, robot.force_torque, robot.gripper_motor
        settings = PlantSettings(seed=seed, torque_share=1 - np.exp(-self.dt_s / servo.torque_time_constant_s))
        _fill(settings.ft_noise, np.repeat([ft.noise_N, ft.noise_Nm], 3))
        _fill(settings.ft_bias, np.repeat([ft.bias_N, ft.bias_Nm], 3))
        _fill(settings.hand_rotation, hand_rotation)
        turn_rad = 2 * np.pi / robot.motor.gear_ratio  # of the joint, in one of its rotor, where the encoder is
        settings.encoder_step_rad = turn_rad / robot.drive.encoder_counts
        settings.encoder_noise_rad = turn_rad * ENCODER_NOISE_TURNS
        settings.encoder_noise_rad_s = settings.encoder_noise_rad * ENCODER_NOISE_1_S
        # A rotor's windings in short circuit take k_t^2 / (1.5 R) a speed; there are 1.5 k_e in a k_t of amplitudes.
        rotor_nms_rad = robot.motor.torque_constant_Nm_A**2 / (1.5 * robot.motor.resistance_ohm)
        settings.braking_nms_rad = robot.motor.gear_ratio**2 * rotor_nms_rad
        settings.idle_friction_nm = IDLE_FRICTION_NM
        settings.screw_middle = 0.5 * (2 + (motor.screw_release_torque - 1) / motor.screw_efficiency)
        settings.screw_width = 0.5 * (1 + motor.screw_release_torque) / motor.screw_efficiency
        return settings

    def _map(self) -> PlantMap:
        robot = self.robot
        names = ("driven_qpos", "driven_dof", "joint_actuators", "finger_qpos", "finger_dof", "finger_actuators")
        places = PlantMap(body=robot.body, slots=robot.robot.slots)
        actuators = ("ratio", "coupling", "offset_rad", "coupled_to", "tendon")
        for name in (*names, *actuators, "ft_sensors", "gripper_sites", "pad_geoms"):
            _fill(getattr(places, name), getattr(robot, name))
        _fill(places.spine_actuators, robot.spine_actuators if len(robot.spine_actuators) else np.full(8, -1))
        self._tables = (
            robot.pad_of_geom.astype(np.int32),
            robot.face_of_geom.astype(np.int32),
            robot.adhesion_of_face.astype(np.float64),
        )  # the map points into them
        places.pad_of_geom, places.face_of_geom, places.adhesion_of_face = (table.ctypes.data for table in self._tables)
        return places

    def _view(self, name: str) -> NDArray[Any]:
        """The plant's own numbers."""
        return np.ctypeslib.as_array(getattr(self._state, name))

    @property
    def cycle(self) -> int:
        """Steps so far."""
        return int(self._state.cycle)

    @property
    def link_contact_force_n(self) -> float:
        """Greatest normal force on anything but a pad at the last look at the contacts."""
        return float(self._state.link_contact_force_n)

    @property
    def time_s(self) -> float:
        """Physics time since the robot was set on the wall."""
        return self.cycle * self.dt_s

    def drive(self, joints: Sequence[int], limbs: Sequence[int]) -> None:
        """From now on the torque of these joints (of 4 S) is that of a motor, without the lag that stands for one, and
        the finger force of these limbs is that of a motor before its screw's friction."""
        for joint in joints:
            self._native.crux_plant_drive_joint(self.handle, joint)
        for limb in limbs:
            self._native.crux_plant_drive_gripper(self.handle, limb)

    def carry(self) -> None:
        """The hand that carries the body at first goes on for 0.5 s from now, and releases it in the second after."""
        self._native.crux_plant_carry(self.handle)

    def step(self, joint_torque_nm: Floats, finger_force_n: Floats) -> None:
        """One control cycle: torques of the actuators (4 S,), squeeze a finger (4,), positive closes."""
        torque = np.ascontiguousarray(joint_torque_nm, dtype=np.float64)
        force = np.ascontiguousarray(finger_force_n, dtype=np.float64)
        self._native.crux_plant_step(self.handle, torque.ctypes.data_as(DOUBLES), force.ctypes.data_as(DOUBLES))

    def record(self, cycle: int, climbing: int) -> None:
        """Keeps a sample of what really is, when this step looked at the contacts; `cycle` is the runtime's count, the
        same again while it is silent, `climbing` whether it climbs, as the nodes receive it (-1: in reverse). Read them
        by recorder.recorded()."""
        self._native.crux_plant_record(self.handle, cycle, climbing)

    def limbs_on_holds(self) -> NDArray[np.bool_]:
        """(4,) whether both pads of a limb touch a hold (feet: one the wall) at the last look."""
        if self.robot.point_feet:
            return np.asarray((self.pad_face >= 0).reshape(4, 2).any(axis=1))
        on_hold = (self.pad_face >= 0) & (self.robot.face_hold[self.pad_face] >= 0)
        on_wall = (self.pad_face >= 0) & ~on_hold
        stands = on_wall.reshape(4, 2).any(axis=1) & self.robot.stands
        return np.asarray(on_hold.reshape(4, 2).all(axis=1) | stands)
