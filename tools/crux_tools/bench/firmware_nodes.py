"""The 28 firmware nodes of a robot: the real cores behind real CAN frames, driven by the bench's clock and physics."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType, TracebackType
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from numpy.typing import NDArray

from crux_tools.bench.plant import Plant
from crux_tools.errors import WorkFailed
from crux_tools.paths import ROOT, built

BINDING = ROOT / "firmware" / "ports" / "host" / "crux_nodes.py"
LIBRARY = "firmware/libcrux_nodes.so"
HASH_DIGITS = 8  # of the robot's hash that fit the 32-bit ParameterHash

Floats = NDArray[np.float64]


def _binding() -> ModuleType:
    """The firmware's own ctypes binding; it lives beside the header it mirrors, not on the Python path."""
    name = "crux_nodes"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, BINDING)
        if spec is None or spec.loader is None:
            raise WorkFailed(f"{BINDING} cannot be loaded")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


def joint_parameters(binding: Any, robot: Robot) -> list[Any]:
    """JointParameters of 24 joints, limb-major."""
    servo, can = robot.servo, robot.can
    return [
        binding.JointParameters(
            position_min_rad=joint.lower,
            position_max_rad=joint.upper,
            velocity_limit_rad_s=joint.velocity,
            torque_limit_Nm=joint.effort,
            position_gain_Nm_rad=servo.position_gain_Nm_rad[index],
            velocity_gain_Nms_rad=servo.velocity_gain_Nms_rad[index],
            setpoint_time_constant_s=servo.setpoint_time_constant_s,
            max_deceleration_rad_s2=servo.max_deceleration_rad_s2,
            temperature_limit_degC=servo.temperature_limit_degC,
            period_us=round(1e6 * can.dt_s),
            watchdog_cycles=can.watchdog_cycles,
        )
        for limb in robot.limbs
        for index, joint in enumerate(limb.joints)
    ]


def gripper_parameters(binding: Any, robot: Robot) -> list[Any]:
    """GripperParameters of four grippers."""
    gripper, ft, can = robot.gripper, robot.force_torque, robot.can
    return [
        binding.GripperParameters(
            opening_min_m=gripper.opening_m[0],
            opening_max_m=gripper.opening_m[1],
            speed_limit_m_s=gripper.max_finger_speed_m_s,
            force_limit_N=gripper.max_finger_force_N,
            stiffness_N_m=gripper.stiffness_N_m,
            damping_Ns_m=gripper.damping_Ns_m,
            force_range_N=ft.range_N,
            moment_range_Nm=ft.range_Nm,
            temperature_limit_degC=gripper.temperature_limit_degC,
            period_us=round(1e6 * can.dt_s),
            watchdog_cycles=can.watchdog_cycles,
        )
        for _ in robot.limbs
    ]


class FirmwareNodes:
    """24 joint nodes and 4 gripper nodes on four buses; leaving the context closes the buses."""

    def __init__(self, bus_urls: Sequence[str], robot: Robot) -> None:
        """Raises WorkFailed when a bus cannot be opened."""
        binding = _binding()
        self._error: type[Exception] = binding.NodesError
        joints, grippers = joint_parameters(binding, robot), gripper_parameters(binding, robot)
        try:
            self._nodes = binding.Nodes(built(LIBRARY), bus_urls, joints, grippers, int(robot.hash[:HASH_DIGITS], 16))
        except binding.NodesError as error:
            raise WorkFailed(f"firmware nodes: {error}") from error

    def __enter__(self) -> FirmwareNodes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._nodes.close()

    def wait_sync(self, timeout_s: float) -> int | None:
        """Cycle of the next Sync on all buses, None after `timeout_s`."""
        cycle: int | None = self._nodes.wait_sync(timeout_s)
        return cycle

    def control(self, plant: Plant) -> tuple[Floats, Floats]:
        """One control period of every node: joint torques (24,), finger forces (4,); overwritten by the next call."""
        torque, force = self._nodes.control(
            plant.dt_s,
            plant.joint_position_rad,
            plant.joint_velocity_rad_s,
            plant.finger_opening_m,
            plant.finger_speed_m_s,
            plant.finger_force_n,
        )
        return torque, force

    def publish(self, plant: Plant) -> None:
        """Sends what the nodes owe: status and force/torque."""
        self._nodes.publish(
            plant.joint_position_rad,
            plant.joint_velocity_rad_s,
            plant.joint_torque_nm,
            plant.finger_opening_m,
            plant.finger_speed_m_s,
            plant.finger_force_n,
            plant.ft,
        )

    def host_state(self) -> int:
        """HostState of the last heartbeat, 0xFF before the first."""
        return int(self._nodes.host_state())
