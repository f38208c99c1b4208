"""`crux sim`: a robot to practise with, for the operator's own commands in another terminal."""

from __future__ import annotations

import argparse
import shlex
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_msgs import robot_state_t
from crux_tools.arguments import taught, whole
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import alone_with, note

from crux_simulation.sim.disturbance import STATE_MASK
from crux_simulation.sim.loop import CLIMBING, UNKNOWN, Ending, Loop, WorldClock

if TYPE_CHECKING:
    from crux_contracts.robot import Robot

_DESCRIPTION = """Simulates a robot to practise with: crux-runtime, 28 firmware nodes on CAN over UDP, and the robot of
PLAN.mcap on that plan's wall in real-time physics. The robot is supported externally until the runtime takes control.
In another terminal run crux status, upload, start, hold, reverse or guide, as for a real robot. Ctrl-C or crux
shutdown --force ends it. The log is the runtime's own. A runtime that is killed is started again, as on a
robot, and finds its robot hanging; its log gets a number."""
_EXAMPLES = (
    "crux sim out/plan.mcap -o out/practice.mcap &",
    "crux status",
    "crux upload out/plan.mcap && crux start",
    "pkill -9 crux-runtime",
    "crux sim out/plan.mcap -o out/practice.mcap --world tools/worlds/hold-vanishes-four.yaml",
)


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux sim`."""
    from crux_tools.operator_link import DEFAULT_URL

    parser = subparsers.add_parser("sim", help="simulate a robot to practise with", **taught(_DESCRIPTION, *_EXAMPLES))
    parser.add_argument("plan", type=Path, metavar="PLAN.mcap", help="a plan: its wall, its robot and where it begins")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="LOG.mcap", help="the runtime's log")
    parser.add_argument(
        "--lcm", default=DEFAULT_URL, metavar="URL", help="LCM URL of the runtime (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="N", help="seed for sensor noise and bias (default: %(default)s)"
    )
    parser.add_argument(
        "--world", type=Path, metavar="WORLD.yaml", help="how the simulated world differs from the plan"
    )
    parser.add_argument(
        "--world-seed", type=whole(0), default=0, metavar="N", help="seed for the numbers that the world draws"
    )
    parser.add_argument(
        "--keys", type=Path, metavar="FILE", help="who may command it, as crux-runtime --keys (default: everybody)"
    )
    parser.add_argument("--note", default="", metavar="TEXT", help="note to store in the log; crux log ls shows it")
    parser.set_defaults(func=run)


@dataclass
class Practice(Loop):
    """Goes on until the runtime ends. Nothing is recorded: hours of it need no memory."""

    _climbed: bool = field(default=False, init=False)

    def over(self, cycle: int) -> Ending | None:  # noqa: ARG002
        """Never; until the runtime has taken over, the hand carries the robot. A runtime that starts again while the
        robot is on the wall is IDLE, too."""
        state = self.nodes.host_state()
        self._climbed = self._climbed or (state != UNKNOWN and state & STATE_MASK == CLIMBING)
        if not self._climbed and (state == UNKNOWN or state & STATE_MASK == robot_state_t.IDLE):
            self.plant.carry()
        return None

    def _step(self, cycle: int, heard: bool = True) -> None:  # noqa: ARG002
        self.nodes.step(self.plant)
        self.nodes.publish(self.plant)

    def _free_run(self, last: int) -> bool:  # noqa: ARG002
        return False


def _tags(options: argparse.Namespace) -> dict[str, str]:
    from crux_commit import COMMIT

    tags = {"seed": str(options.seed), "crux_commit": COMMIT, "crux_command_line": shlex.join(sys.argv)}
    return tags | ({"note": options.note} if options.note else {})


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the runtime was shut down, or on Ctrl-C."""
    from crux_contracts.output_file import look_at_outputs
    from crux_contracts.plan_file import read_plan
    from crux_tools.plan_robot import robot_of_plan

    from crux_simulation.sim.climb import ClimbOptions
    from crux_simulation.sim.world_file import read_world

    plan = read_plan(options.plan)
    robot = robot_of_plan(plan, options.plan)
    if options.world is None and options.world_seed:
        raise UsageError("--world-seed: there is nothing to draw; give --world WORLD.yaml, too")
    world = None if options.world is None else read_world(options.world).draw(options.world_seed, plan)
    look_at_outputs({"-o": options.output}, (options.plan, options.world))
    wanted = ClimbOptions("realtime", "udp", options.seed, world=world)
    with alone_with(options.output):
        try:
            _practise(options, plan, robot, wanted)
        except KeyboardInterrupt:
            note(f"crux sim: ended; the log is {options.output}")
    return 0


def _practise(options: argparse.Namespace, plan: Any, robot: Robot, wanted: Any) -> None:
    from crux_tools.operator_link import OperatorLink
    from crux_tools.priority import no_garbage_collection, realtime_priority

    from crux_simulation.sim.climb import PACES, plant_of
    from crux_simulation.sim.firmware_nodes import FirmwareNodes
    from crux_simulation.sim.ports import run_ports
    from crux_simulation.sim.runtime_process import GUARD_TIME_S, RuntimeProcess, runtime_arguments

    plant = plant_of(plan, robot, wanted)
    with ExitStack() as stack:
        buses = stack.enter_context(run_ports()).bus_urls()
        state = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="crux-sim-")))
        arguments = runtime_arguments(
            robot.folder, options.output, wanted.commands, _tags(options), None, options.keys, state
        )
        runtime = stack.enter_context(RuntimeProcess(buses, PACES[wanted.pace], options.lcm, GUARD_TIME_S, arguments))
        with OperatorLink(options.lcm) as link:
            runtime.await_answer(link)
        nodes = stack.enter_context(FirmwareNodes(buses, robot, world=wanted.world))
        stack.enter_context(no_garbage_collection())
        if not stack.enter_context(realtime_priority()):
            note("crux sim: no permission for SCHED_FIFO; other programs may delay the simulation")
        note(f"crux sim: the robot is there; in another terminal: crux upload {options.plan}, crux start, crux status")
        clock = WorldClock(plant.dt_s)
        outcome = Practice(nodes, plant, runtime.goes_on, lambda _time_s: None, 0, clock=clock).run()
        runtime.wait()
        if runtime.crashed or outcome.ending is not Ending.RUNTIME_DIED:
            raise WorkFailed(f"crux-runtime {runtime.last_words()}")
        if trouble := runtime.log_trouble():
            raise WorkFailed(f"log incomplete: {trouble}")
    note(f"crux sim: the runtime was shut down; the log is {options.output}")
