"""`crux climb`: run a plan in the hardware-in-the-loop simulation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught, whole
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json, progress

_DESCRIPTION = """Runs a plan in simulation: the runtime's own code, 24 joint and 4 gripper nodes (the real firmware
cores) on four CAN buses, and a MuJoCo robot on the plan's wall. It uploads the plan, climbs, and judges the climb by
what happened in physics. By default everything runs in one process with buses in memory, as fast as possible; with
--bus udp or socketcan the runtime is a separate process, as on the robot. In lockstep the log is the same on all of
them, except /cycle_timing. Simulations can run side by side. Exit status 0: the goal is reached without slip or fall,
and the log is complete; tools/README.md defines these."""
_EXAMPLES = (
    "crux climb out/plan.mcap -o out/climb.mcap",
    "crux climb out/plan.mcap -o out/climb.mcap --pace realtime --json",
    "crux climb out/plan.mcap -o out/climb.mcap --world tools/worlds/combined.yaml --world-seed 3",
    "crux climb out/plan.mcap -o out/climb.mcap --emulate LF.1 --report out/climb.html",
    "crux can run --virtual-time -i can0,can1,can2,can3 -- \\\n"
    "    crux climb out/plan.mcap -o out/climb.mcap --bus socketcan --pace realtime",
)


BUS_WORDS = {
    "memory": "all in one process",
    "udp": "the runtime a process of its own, CAN over UDP",
    "socketcan": "the runtime a process of its own, CAN over SocketCAN",
}


def _add_world_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--world",
        type=Path,
        metavar="WORLD.yaml",
        help="how the simulated world differs from the plan: holds, robot, sensors, pushes; neither planner nor "
        "runtime sees it (examples/world.yaml has every key, tools/worlds has examples)",
    )
    parser.add_argument(
        "--world-seed",
        type=whole(0),
        default=0,
        metavar="N",
        help="seed for the numbers that the world draws (default: %(default)s)",
    )
    parser.add_argument(
        "--drawn-world", type=Path, metavar="FILE.yaml", help="also write the world with all its numbers drawn"
    )


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux climb`."""
    parser = subparsers.add_parser(
        "climb",
        help="run a plan in the hardware-in-the-loop simulation",
        **taught(_DESCRIPTION, *_EXAMPLES),
    )
    parser.add_argument("plan", type=Path, metavar="PLAN.mcap", help="a plan written by crux plan, or a route's folder")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="LOG.mcap", help="telemetry of the climb")
    parser.add_argument(
        "--pace",
        choices=["lockstep", "realtime"],
        default="lockstep",
        help="lockstep: as fast as possible, the same bytes for the same seed; realtime: in real time",
    )
    parser.add_argument(
        "--bus",
        choices=["memory", "udp", "socketcan"],
        help="memory: CAN frames within one process (lockstep's default); udp: CAN over UDP multicast (realtime's "
        "default); socketcan: can0..can3 of this machine",
    )
    parser.add_argument(
        "--commands",
        choices=["each", "broadcast"],
        default="each",
        help="a CAN frame for each node, or one for all nodes of a bus, as 1 kHz needs it (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="N", help="seed for sensor noise and bias (default: %(default)s)"
    )
    parser.add_argument(
        "--faults",
        type=Path,
        metavar="FILE.yaml",
        help="what goes wrong on the buses or with the runtime's process, and when (docs/worlds.md has the kinds)",
    )
    _add_world_options(parser)
    _add_planning_options(parser)
    parser.add_argument(
        "--calibrate",
        action="store_true",
        help="tune the admittance's gains from the wrench errors while climbing (runtime/README.md says how)",
    )
    parser.add_argument(
        "--emulate",
        metavar="NODES",
        help="run the real image of these nodes on emulated microcontrollers: limbs and nodes, such as LF,RF.7, or all "
        "(for tests; needs make build)",
    )
    _add_log_options(parser)
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="also write a report of the climb")
    add_json_option(parser)
    parser.set_defaults(func=run)


def _add_planning_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--guide",
        action="store_true",
        help="when the robot holds for a reason that another plan may avoid, plan again and go on, as crux guide "
        "does on the robot (--bus memory)",
    )
    parser.add_argument(
        "--replan",
        action="store_true",
        help="plan the moves ahead again after each new grasp, where holds are not as on the map, as crux upload "
        "--replan does on the robot (--bus memory)",
    )


def _add_log_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--note", default="", metavar="TEXT", help="note to store in the log; crux log ls shows it")
    parser.add_argument(
        "--log-frames",
        action="store_true",
        help="log the CAN frames of every cycle, not only of the seconds around a fault",
    )


def _amount(value: float | None, scale: float, digits: int = 1) -> str:
    return "–" if value is None else f"{value * scale:.{digits}f}"


def _print_summary(result: Any) -> None:
    from crux_tools.telemetry.wording import touching

    verdict, tracking = result.verdict, result.tracking
    lost = "".join(f", {limb} lost its hold" for limb in verdict.lost_grips)
    note(f"{'climbed' if result.ok else 'failed'}: {result.reason or 'the robot is at the goal'}")
    note(
        f"  goal      {verdict.goal_error_m * 1e3:.1f} mm off, {'reached' if verdict.reached_goal else 'not reached'}; "
        f"{verdict.slips} slips (largest {verdict.largest_slip_m * 1e3:.2f} mm), "
        + ", ".join([f"{'a' if verdict.fell else 'no'} fall{lost}", *touching(verdict)])
    )
    note(
        f"  tracking  body {_amount(tracking.body_max_m, 1e3)} mm max, {_amount(tracking.body_rms_m, 1e3)} mm rms; "
        f"gripper {_amount(tracking.finger_max_m, 1e3)} mm max; force {_amount(tracking.force_rms_n, 1, 2)} N rms"
    )
    note(
        f"  time      {result.outcome.cycles} cycles at {result.real_time_factor:.2f} x real time, "
        f"{result.missed_cycles} missed; {BUS_WORDS[result.bus]}"
    )
    for course in result.courses:
        fault = course.as_json()
        on = "" if fault["limb"] is None else f" on {fault['limb']}"
        stopped = (
            "climbed on" if course.runtime_s is None else f"stopped climbing after {course.runtime_s * 1e3:.0f} ms"
        )
        if result.outcome.robot_on_wall is not None:
            stopped = "the runtime died"
        held = "" if course.held_s is None else f", held after {course.held_s * 1e3:.0f} ms"
        cause = "" if course.cause is None else f" ({course.cause})"
        moved = "" if course.moved_m is None else f", body moved {course.moved_m * 1e3:.1f} mm"
        note(f"  fault     {fault['kind']}{on} at {fault['at_s']:g} s: {stopped}{cause}{held}{moved}")
    for told in result.joint_notes:
        note(f"  joints    {told}")
    note(f"  log       {result.log}")


def _write_report(result: Any, log: Path, page: Path) -> None:
    """The page about the climb; the climb's verdict stands there also where the log could not take it."""
    from crux_tools.report.command import write_report
    from crux_tools.telemetry import LogError

    try:
        note(f"  report    {write_report(log, page, verdict=result.as_message()).file}")
    except LogError as error:
        note(f"  report    none: {error}")


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the robot is at the goal without slip, lost grip or fall, and the log is complete; else 1."""
    from crux_contracts.output_file import look_at_outputs, write_whole
    from crux_contracts.plan_file import read_plan
    from crux_contracts.plan_route import read_route
    from crux_tools.output import alone_with
    from crux_tools.plan_robot import robot_of_plan

    from crux_simulation.sim.climb import ClimbOptions, climb
    from crux_simulation.sim.emulated_boards import read_places
    from crux_simulation.sim.fault_file import read_faults
    from crux_simulation.sim.world_file import read_world

    plan, *parts = (
        [part for _, part in read_route(options.plan)] if options.plan.is_dir() else [read_plan(options.plan)]
    )
    robot = robot_of_plan(plan, options.plan)
    faults = tuple(read_faults(options.faults)) if options.faults is not None else ()
    emulated = read_places(options.emulate, robot.slots) if options.emulate is not None else ()
    if options.world is None and (options.drawn_world is not None or options.world_seed):
        raise UsageError("--world-seed and --drawn-world: there is nothing to draw; give --world WORLD.yaml, too")
    world = None if options.world is None else read_world(options.world).draw(options.world_seed, plan)
    look_at_outputs(
        {"-o": options.output, "--report": options.report, "--drawn-world": options.drawn_world},
        (options.plan, options.faults, options.world),
    )
    if world is not None and options.drawn_world is not None:
        write_whole(options.drawn_world, world.as_yaml().encode())
    bus = options.bus or ("memory" if options.pace == "lockstep" else "udp")
    if bus == "memory" and options.pace == "realtime":
        raise UsageError("--bus memory: one process has no clock to keep; --pace realtime needs --bus udp or socketcan")
    if parts and (bus != "memory" or options.guide):
        raise UsageError("a route in parts is climbed with --bus memory and without --guide")
    if options.guide and bus != "memory":
        raise UsageError(f"--guide: with --bus {bus} the runtime is a process of its own; start crux guide beside it")
    if options.replan and (bus != "memory" or parts or options.guide):
        raise UsageError(
            "--replan: with --bus memory, one plan and without --guide; elsewhere crux upload --replan does it"
        )
    wanted = ClimbOptions(
        options.pace, bus, options.seed, faults, emulated, options.commands, world, options.guide,
        calibrate=options.calibrate, note=options.note, log_frames=options.log_frames, replan=options.replan,
    )  # fmt: skip
    length_s = sum(each.knots[-1].time_s for each in (plan, *parts))
    with alone_with(options.output), progress("climbing", length_s) as bar:
        result = climb(plan, robot, options.output, wanted, bar.at, parts)
    if options.json:
        print_json(result.as_json())
    else:
        _print_summary(result)
    if options.report is not None:
        _write_report(result, options.output, options.report)
    return 0 if result.ok else 1
