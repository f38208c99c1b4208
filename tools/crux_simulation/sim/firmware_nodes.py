"""The firmware nodes of a robot: the real cores behind real CAN frames, driven by the bench's clock and physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from crux_contracts import LIMB_NAMES
from crux_contracts.can_codec import JOINT_NODES
from crux_contracts.robot import Robot
from crux_tools.errors import WorkFailed
from crux_tools.paths import built

from crux_simulation.sim.disturbance import Injector
from crux_simulation.sim.emulated_boards import EmulatedBoards
from crux_simulation.sim.firmware_binding import crux_nodes
from crux_simulation.sim.native import library
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.world import JOINT_NAMES, World

LIBRARY = "firmware/libcrux_nodes.so"


class FirmwareNodes:
    """A node for each joint and each gripper on four buses; leaving the context closes the buses."""

    def __init__(
        self,
        bus_urls: Sequence[str],
        robot: Robot,
        boards: EmulatedBoards | None = None,
        world: World | None = None,
    ) -> None:
        """`boards` take the places of nodes; in a `world` position loops and grippers may be slower than described.
        Raises WorkFailed when a bus cannot be opened."""
        host = crux_nodes()
        joints, grippers = host.joint_parameters(robot), host.gripper_parameters(robot)
        for name, joint in zip(JOINT_NAMES, joints, strict=True):
            change = world.joints.get(name) if world is not None else None
            if change is not None and change.setpoint_time_constant_s is not None:
                joint.setpoint_time_constant_s = change.setpoint_time_constant_s
        for limb, gripper in zip(LIMB_NAMES, grippers, strict=True):
            slowed = world.grippers.get(limb) if world is not None else None
            if slowed is not None:
                gripper.speed_limit_m_s = min(gripper.speed_limit_m_s, slowed.speed_limit_m_s)
        try:
            self._nodes = host.Nodes(built(LIBRARY), bus_urls, joints, grippers, host.parameter_hash(robot))
        except host.NodesError as error:
            raise WorkFailed(f"firmware nodes: {error}") from error
        for number, own in enumerate(robot.limbs):
            for node in JOINT_NODES[len(own.joints) :]:
                self._nodes.disturb(number, node, True)  # there is none
        self._sim = library()
        self.handle = self._nodes.handle
        self.before_sync: Callable[[], None] = lambda: None
        """called before each look for a Sync: where the runtime runs in this process, it has its turn here"""
        for place, port in boards.ports() if boards is not None else ():
            self._nodes.replace(place.limb, place.node, port)

    def __enter__(self) -> FirmwareNodes:
        return self

    def __exit__(self, *_: object) -> None:
        self._nodes.close()

    @property
    def injector(self) -> Injector:
        """What can be done to the nodes and their buses."""
        injector: Injector = self._nodes
        return injector

    def wait_sync(self, timeout_s: float) -> int | None:
        """Cycle of the next Sync on all buses, None after `timeout_s`."""
        self.before_sync()
        cycle: int | None = self._nodes.wait_sync(timeout_s)
        return cycle

    def step(self, plant: Plant) -> None:
        """One control period of every node, and of the physics with what they command."""
        self._sim.crux_sim_step(self.handle, plant.handle, plant.dt_s)

    def publish(self, plant: Plant) -> None:
        """Sends what the nodes owe: status and force/torque."""
        if self._sim.crux_sim_publish(self.handle, plant.handle) != 0:
            raise WorkFailed("firmware nodes: a bus refuses their frames")

    def host_state(self) -> int:
        """HostState of the last heartbeat, 0xFF before the first."""
        return int(self._nodes.host_state())
