"""The 28 firmware nodes of a robot: the real cores behind real CAN frames, driven by the bench's clock and physics."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType, TracebackType

import numpy as np
from crux_contracts.robot import Robot
from numpy.typing import NDArray

from crux_tools.bench.disturbance import Injector
from crux_tools.bench.plant import Plant
from crux_tools.errors import WorkFailed
from crux_tools.paths import ROOT, built

BINDING = ROOT / "firmware" / "ports" / "host" / "crux_nodes.py"
LIBRARY = "firmware/libcrux_nodes.so"

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


class FirmwareNodes:
    """24 joint nodes and 4 gripper nodes on four buses; leaving the context closes the buses."""

    def __init__(self, bus_urls: Sequence[str], robot: Robot) -> None:
        """Raises WorkFailed when a bus cannot be opened."""
        binding = _binding()
        joints, grippers = binding.joint_parameters(robot), binding.gripper_parameters(robot)
        try:
            self._nodes = binding.Nodes(built(LIBRARY), bus_urls, joints, grippers, binding.parameter_hash(robot))
        except binding.NodesError as error:
            raise WorkFailed(f"firmware nodes: {error}") from error

    def __enter__(self) -> FirmwareNodes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._nodes.close()

    @property
    def injector(self) -> Injector:
        """What can be done to the nodes and their buses."""
        injector: Injector = self._nodes
        return injector

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
