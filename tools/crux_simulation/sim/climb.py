"""One climb in hardware-in-the-loop: runtime process, CAN buses, firmware nodes, physics, verdict."""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING

from crux_can_kernel.native import available
from crux_contracts import LIMB_NAMES
from crux_contracts.plan_route import joined
from crux_contracts.robot import Robot
from crux_msgs import command_t, plan_t
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.operator_link import OperatorLink
from crux_tools.output import note
from crux_tools.priority import no_garbage_collection, realtime_priority
from crux_tools.report.joints import joint_loads
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry.channels import LogError
from crux_tools.telemetry.reader import read_log
from crux_tools.telemetry.summary import FaultNote, summarise
from crux_tools.telemetry.wording import fault_line
from mujoco import MjSpec

from crux_simulation.sim.climb_result import ClimbResult, reason_of
from crux_simulation.sim.disturbance import Course, Disturbance, look_back
from crux_simulation.sim.emulated_boards import GRIPPER, EmulatedBoards, Place
from crux_simulation.sim.fault_file import OF_THE_RUNTIME, Fault
from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.judge import Tracking, judge, track
from crux_simulation.sim.loop import START_CYCLE, SYNC_TIMEOUT_S, Ending, Loop, Outcome, WorldClock
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.ports import run_ports
from crux_simulation.sim.process_faults import ProcessFaults, check_process_faults
from crux_simulation.sim.recorder import recorded
from crux_simulation.sim.resumed import Resumed
from crux_simulation.sim.runtime_here import RuntimeHere
from crux_simulation.sim.runtime_process import STOP_TIMEOUT_S, RuntimeProcess, guard_time_s, runtime_arguments
from crux_simulation.sim.streamed import Streamed
from crux_simulation.sim.truth_log import log_truth
from crux_simulation.sim.world import World
from crux_simulation.sim.world_model import change_robot, cut_corners, loosen_holds, plant_world, true_wall

if TYPE_CHECKING:
    from crux_simulation.sim.guided import Guided
    from crux_simulation.sim.replanned import Replanned

PACES = {"lockstep": "bus", "realtime": "clock"}  # the bench's words and the runtime's
EXTRA_TIME_S = 30.0  # events may stop the plan's clock
EXTRA_TIME_SHARE = 1.0  # of the plan's duration
INTERFACES = [f"can{bus}" for bus in range(4)]
RETURN_CYCLES = 20  # nodes may need so many after a fault until they answer again
WATCHED_S = 10.0  # what becomes of a robot that stops in a world that is not the plan


@dataclass(frozen=True)
class ClimbOptions:
    """How to run a climb."""

    pace: str = "lockstep"
    bus: str = "memory"
    """memory (the runtime in this process), udp or socketcan (a process of its own)"""
    seed: int = 0
    faults: tuple[Fault, ...] = ()
    emulated: tuple[Place, ...] = ()
    """nodes that run their image on an emulated microcontroller"""
    commands: str = "each"
    """CAN frames of the commands: each (one a node) or broadcast (one for all)"""
    world: World | None = None
    """how the simulated world differs from the plan and the robot description"""
    guide: bool = False
    """plans again where the robot holds for a reason that another plan may avoid"""
    resumes: bool = False
    """an operator clears what it holds for and has it go on"""
    replan: bool = False
    """plans the moves ahead again on the way, where holds are not as on the map"""
    calibrate: bool = False
    """tunes the admittance's gains while it climbs"""
    note: str = ""
    """the user's own words, for the log"""
    log_frames: bool = False
    """the CAN frames of every cycle into the log, not of the seconds around a fault alone"""


def _tags(options: ClimbOptions) -> dict[str, str]:
    """What the runtime cannot know of the run, for its log."""
    from crux_commit import COMMIT

    tags = {"seed": str(options.seed), "crux_commit": COMMIT, "crux_command_line": shlex.join(sys.argv)}
    tags |= {"note": options.note} if options.note else {}
    world = options.world
    if world is not None:
        tags |= {"world": world.name, "world_sha256": world.source_sha256, "world_seed": str(world.seed)}
    return tags


def plant_of(plan: plan_t, robot: Robot, options: ClimbOptions) -> Plant:
    """The robot on the wall of `plan`, or on what the world has made of it."""
    world = options.world
    if world is None:
        return Plant(build_model(robot, plan), plan, options.seed)
    wall = true_wall(plan, world)

    def change(spec: MjSpec) -> None:
        change_robot(spec, robot, world)
        cut_corners(spec, wall, world)
        loosen_holds(spec, plan, world)

    model = build_model(robot, wall, change)
    return Plant(model, wall, options.seed, plant_world(world, model, [hold.name for hold in plan.holds]))


def _shut_down(runtime: RuntimeProcess | RuntimeHere, link: OperatorLink, realtime_loop: Loop | None) -> None:
    """FORCE_SHUTDOWN, for the simulated robot is still on its wall; in real time the nodes answer until the runtime is
    gone, or it would log a fault."""
    end_s = time.monotonic() + STOP_TIMEOUT_S
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(link.command, command_t.FORCE_SHUTDOWN)
        if realtime_loop is not None:
            realtime_loop.serve(lambda: not runtime.is_alive() or time.monotonic() > end_s)
        if asked.result() is None:
            note("crux climb: the runtime does not answer; ending it")


def _operator(
    loop: Loop,
    link: OperatorLink,
    runtime: RuntimeProcess | RuntimeHere,
    plan: plan_t,
    robot: Robot,
    options: ClimbOptions,
) -> Guided | None:
    """Puts beside `loop` who goes on after a fault; the guide, where that is one."""
    if not isinstance(runtime, RuntimeHere) or not (options.guide or options.resumes):
        return None
    loop.max_cycles *= 2
    if not options.guide:
        loop.guided = Resumed(link, runtime, loop)
        return None
    from crux_simulation.sim.guided import Guided  # with the whole planner: slow to import

    guided = loop.guided = Guided(link, runtime, loop, plan, robot)
    return guided


def _on_the_way(
    loop: Loop,
    link: OperatorLink,
    runtime: RuntimeProcess | RuntimeHere,
    plan: plan_t,
    robot: Robot,
    options: ClimbOptions,
    parts: Sequence[plan_t],
) -> Replanned | None:
    """Puts beside `loop` who uploads while the robot climbs; who plans again, where that is wanted."""
    if not isinstance(runtime, RuntimeHere):
        return None
    if parts:
        loop.between = Streamed(link, runtime, loop, plan, parts)
    if not options.replan:
        return None
    from crux_simulation.sim.replanned import Replanned  # with the whole planner: slow to import

    replanned = loop.between = Replanned(link, runtime, loop, plan, robot)
    return replanned


def climb(
    plan: plan_t,
    robot: Robot,
    log: Path,
    options: ClimbOptions,
    progress: Callable[[float], None] = lambda _time_s: None,
    parts: Sequence[plan_t] = (),
) -> ClimbResult:
    """Runs `plan` on the bench, and the `parts` of a route that follow it, and judges it; the runtime writes `log`.
    Raises UsageError or WorkFailed.
    """
    if options.bus == "socketcan" and not available():
        raise UsageError(
            "--bus socketcan: this kernel has no CAN; run it under one that has: "
            f"crux can run --virtual-time -i {','.join(INTERFACES)} -- crux climb …"
        )
    check_process_faults(options.faults, options.bus, options.pace)
    whole = reduce(joined, parts, plan)
    plant = plant_of(whole, robot, options)
    with ExitStack() as stack:
        boards = stack.enter_context(EmulatedBoards(options.emulated, robot)) if options.emulated else None
        if boards is not None:
            boards.power_on(plant)
        runtime, link, nodes = _power_on(stack, robot, log, options, plan, boards)
        plant.drive(
            [joint for place in options.emulated if (joint := place.joint(robot.slots)) is not None],
            [place.limb for place in options.emulated if place.node == GRIPPER],
        )
        limit_s = whole.knots[-1].time_s * (1 + EXTRA_TIME_SHARE) + EXTRA_TIME_S
        disturbance = _disturbance(stack, runtime, nodes, plant, log, options) if options.faults else None
        watched_s = WATCHED_S if options.world is not None else 0.0
        clock = WorldClock(plant.dt_s) if options.pace == "realtime" else None
        loop = Loop(nodes, plant, runtime.is_alive, progress, int(limit_s / plant.dt_s), disturbance, watched_s, clock)
        guided = _operator(loop, link, runtime, plan, robot, options)
        replanned = _on_the_way(loop, link, runtime, plan, robot, options, parts)
        stack.enter_context(no_garbage_collection())
        if options.pace == "realtime" and not stack.enter_context(realtime_priority()):
            note("crux climb: no permission for SCHED_FIFO; other programs may delay the simulation")
        outcome = loop.run()
        if disturbance is not None:
            disturbance.end()
        interrupts = None
        if boards is not None:
            boards.check()
            interrupts = boards.worst_interrupts()
        if outcome.ending is not Ending.RUNTIME_DIED:
            if options.pace != "realtime":
                nodes.wait_sync(SYNC_TIMEOUT_S)  # the runtime has taken the last answers
            _shut_down(runtime, link, loop if options.pace == "realtime" else None)
            runtime.wait()
        unlogged = runtime.log_trouble()
        died = outcome.ending is Ending.RUNTIME_DIED or runtime.crashed
        last_words = runtime.last_words() if died else ""
    courses = tuple(disturbance.courses) if disturbance is not None else ()
    further = guided.legs[1:] if guided is not None else []
    whole = whole if replanned is None else replanned.replanner.plan
    result = _judged([(0, whole), *further], plant, log, outcome, (last_words, unlogged), courses)
    said = guided.as_json() if guided is not None else None
    replans = None if replanned is None else replanned.replanner.as_json()
    result = replace(result, bus=options.bus, worst_interrupts=interrupts, guide=said, replans=replans)
    return _logged(result, plant, options.world)


def _power_on(
    stack: ExitStack,
    robot: Robot,
    log: Path,
    options: ClimbOptions,
    plan: plan_t,
    boards: EmulatedBoards | None,
) -> tuple[RuntimeProcess | RuntimeHere, OperatorLink, FirmwareNodes]:
    """Runtime and nodes on the buses of `options`; the plan is loaded and START given for START_CYCLE."""
    switches = {"--log-frames": options.log_frames, "--calibrate": options.calibrate}
    arguments = runtime_arguments(robot.folder, log, options.commands, _tags(options), switches)
    runtime: RuntimeProcess | RuntimeHere
    if options.bus == "memory":
        nodes = stack.enter_context(FirmwareNodes(["memory:"] * len(LIMB_NAMES), robot, boards, options.world))
        runtime = stack.enter_context(RuntimeHere(nodes, arguments))
        link = stack.enter_context(OperatorLink(connection=runtime))
        _start(runtime, link, plan)
        return runtime, link, nodes
    ports = stack.enter_context(run_ports())
    buses = ports.bus_urls() if options.bus == "udp" else [f"socketcan:{interface}" for interface in INTERFACES]
    on_buses = [fault for fault in options.faults if fault.kind not in OF_THE_RUNTIME]
    guard_s = guard_time_s(sum(fault.for_s / robot.dt_s + RETURN_CYCLES for fault in on_buses))
    runtime = stack.enter_context(RuntimeProcess(buses, PACES[options.pace], ports.lcm_url, guard_s, arguments))
    link = stack.enter_context(OperatorLink(ports.lcm_url))
    _start(runtime, link, plan)  # before there are nodes: they would make it begin
    return runtime, link, stack.enter_context(FirmwareNodes(buses, robot, boards, options.world))


def _disturbance(
    stack: ExitStack,
    runtime: RuntimeProcess | RuntimeHere,
    nodes: FirmwareNodes,
    plant: Plant,
    log: Path,
    options: ClimbOptions,
) -> Disturbance:
    interfaces = INTERFACES if options.bus == "socketcan" else None
    process = stack.enter_context(ProcessFaults(runtime, log)) if isinstance(runtime, RuntimeProcess) else None
    return Disturbance(
        options.faults, nodes.injector, plant.dt_s, interfaces, options.seed, process, options.commands == "broadcast"
    )


def _start(runtime: RuntimeProcess | RuntimeHere, link: OperatorLink, plan: plan_t) -> None:
    runtime.await_answer(link)
    link.upload(plan)
    link.send(command_t.START, plan.plan_id, START_CYCLE)


def _judged(
    legs: list[tuple[int, plan_t]],
    plant: Plant,
    log: Path,
    outcome: Outcome,
    complaints: tuple[str, str],
    courses: tuple[Course, ...],
) -> ClimbResult:
    """`legs`: the plans climbed and the cycles they were taken in; `complaints`: how the runtime ended if it should not
    have, and why its log is incomplete."""
    robot, dt_s, truth = plant.robot, plant.dt_s, recorded(plant)
    last_words, unlogged = complaints
    if not len(truth.cycle):
        raise WorkFailed(f"the runtime made no control cycle{': ' + last_words if last_words else ''}")
    verdict = judge(truth, legs[0][1], robot, outcome.ending is Ending.COMPLETE, legs[1:])
    tracking, reported, missed, passed = Tracking(), list[FaultNote](), 0, list[str]()
    try:
        telemetry = read_log(log)
    except (LogError, OSError) as error:
        unlogged = unlogged or str(error)
    else:
        tracking, reported = track(truth, telemetry, *legs[-1], robot), summarise(telemetry).faults
        missed, passed = int(telemetry.state["missed_cycles"][-1]), joint_loads(telemetry, robot.robot).short_notes()
    look_back(courses, truth, reported, dt_s)
    said = [last_words, f"log incomplete: {unlogged}" if unlogged else ""]
    return ClimbResult(
        outcome=outcome,
        verdict=verdict,
        tracking=tracking,
        real_time_factor=outcome.cycles * dt_s / outcome.wall_s if outcome.wall_s > 0 else 0.0,
        missed_cycles=missed + outcome.missed,
        reason=reason_of(outcome, verdict, [*filter(None, said), *map(fault_line, reported)]),
        log=log,
        log_complete=not (unlogged or last_words),
        courses=courses,
        joint_notes=tuple(passed),
        truth=truth,
        model=robot,
    )


def _logged(result: ClimbResult, plant: Plant, world: World | None) -> ClimbResult:
    """Adds what happened in physics, and the verdict, to the log. A log that cannot take it is incomplete."""
    try:
        verdict = result.as_message(world.name if world else "")
        described = world.as_yaml() if world else ""
        replans = json.dumps(result.replans["each"]) if result.replans and result.replans["each"] else ""
        log_truth(result.log, recorded(plant), plant.robot.face_hold, plant.dt_s, verdict, described, replans)
    except (OSError, ValueError) as error:
        if result.log_complete:
            said = f"log incomplete: no ground truth in it: {getattr(error, 'strerror', None) or error}"
            return replace(result, log_complete=False, reason="; ".join(filter(None, (said, result.reason))))
    return result
