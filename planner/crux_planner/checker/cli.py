"""`crux check PLAN.mcap`: what the checker says, as tables or as one JSON object."""

import argparse
import json
from pathlib import Path
from typing import Any

from crux_contracts.terminal import in_a_line, plain, say
from crux_contracts.yaml_document import DocumentError

from crux_planner.checker.report import CheckReport, JointLoad, PeakTorque, Violation

OK, VIOLATED, UNREADABLE = 0, 1, 2
SHOWN_VIOLATIONS = 20
SHOWN_TIGHTEST = 8

EPILOG = """examples:
  crux check out/plan.mcap
  crux check out/plan.mcap --json
  crux check out/proof.json --scenario msgs/scenarios/climb-four-holds.yaml

what is checked: the limit surface with spines (1)-(4), bounds (7), dynamics (8), real inverse kinematics, joint speeds
and torques (9), contacts (10), clearances (14), start and goal; at the knots and between them. Friction is judged by
(2a) of docs/mathematics.md, which allows up to 7 % less than (2) where shear and twist come together

certificates (crux plan --certificate): whether the file proves its claim, with everything else computed anew from
scenario and robot. The claim is that crux check accepts no plan for that scenario, or none with the same number of
steps that costs less than a bound; planner.margins and other settings of the planner play no part

exit status: 0 the plan passes, or the claim is proven; 1 it does not; 2 the file cannot be read"""


def add_check_parser(subparsers: Any) -> None:
    """Add `check` to the subcommands of crux."""
    parser = subparsers.add_parser(
        "check",
        help="check a plan or a certificate independently of the planner",
        description="Check a plan against every constraint, or a certificate, independently of the planner.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = "a plan, the folder of a route, or a certificate, written by crux plan"
    parser.add_argument("plan", type=Path, metavar="FILE", help=what)
    about = "of a certificate: the scenario that it must be about"
    parser.add_argument("--scenario", type=Path, metavar="SCENARIO", help=about)
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object on standard output")
    parser.set_defaults(func=run_check)


def run_check(args: argparse.Namespace) -> int:
    """Run the command; returns the exit status."""
    from crux_contracts.interpolation import is_walk
    from crux_contracts.plan_file import PlanFileError, read_plan
    from crux_contracts.robot import load_robot, robot_names

    from crux_planner.checker.certificate import is_certificate
    from crux_planner.checker.check import check_plan

    try:
        if args.plan.is_dir():
            return _check_route(args)
        if is_certificate(args.plan):
            return _check_certificate(args)
        plan = read_plan(args.plan)
        if plan.robot_name not in robot_names():
            known = ", ".join(robot_names())
            return _unreadable(args, f"{args.plan}: robot_name: {plan.robot_name!r}: expected one of {known}")
        robot = load_robot(plan.robot_name)
    except (PlanFileError, DocumentError) as error:
        return _unreadable(args, str(error))
    except OSError as error:
        return _unreadable(args, f"{args.plan}: {error.strerror or error}")
    report = check_plan(plan, robot)
    if args.json:
        print(json.dumps(report.to_json()))
    else:
        knots = f"{plan.n_knots} knots in {plan.knots[-1].time_s:g} s"
        title = f"{args.plan}: {plan.scenario_name!r} for {plan.robot_name}, {knots}"
        show(title, report, on_feet=is_walk(plan))
    return OK if report.ok else VIOLATED


def _check_route(args: argparse.Namespace) -> int:
    """Each part of a route, and that it begins where the one before ends. Raises PlanFileError, DocumentError."""
    from crux_contracts.plan_route import read_route
    from crux_contracts.robot import load_robot

    from crux_planner.checker.check import check_plan

    reports = []
    for path, plan in read_route(args.plan):
        report = check_plan(plan, load_robot(plan.robot_name))
        reports.append({"plan": str(path), **report.to_json()})
        if not args.json:
            say(f"{path}: {plan.n_knots} knots in {plan.knots[-1].time_s:g} s: {report}")
    ok = all(each["ok"] for each in reports)
    if args.json:
        print(json.dumps({"ok": ok, "parts": reports}))
    return OK if ok else VIOLATED


def _check_certificate(args: argparse.Namespace) -> int:
    from crux_contracts.scenario import load_scenario

    from crux_planner.checker.certificate import CertificateError, read, verify

    wanted = None if args.scenario is None else load_scenario(args.scenario)
    try:
        document = read(args.plan)
        if wanted is not None and document.get("scenario_yaml") != wanted.yaml_text:
            raise CertificateError(f"about another scenario than {args.scenario}")
        scenario, shown = verify(document)
    except CertificateError as error:
        say(f"crux check: {args.plan}: refused: {error}", to_errors=True)
        if args.json:
            print(json.dumps({"ok": False, "error": str(error)}))
        return VIOLATED
    said = {"ok": True, "scenario": scenario.name, "claim": document["claim"], "shown": shown}
    say(json.dumps(said) if args.json else f"{args.plan}: {scenario.name!r} for {scenario.robot}: shown: {shown}")
    return OK


def _unreadable(args: argparse.Namespace, message: str) -> int:
    say(f"crux check: {message}", to_errors=True)
    if args.json:
        print(json.dumps({"ok": False, "error": message}))
    return UNREADABLE


def show(title: str, report: CheckReport, *, on_feet: bool) -> None:
    """Print a report for people, on standard output; feet do not squeeze."""
    from rich.console import Console
    from rich.markup import escape

    console = Console(highlight=False)
    console.print(escape(plain(title)), soft_wrap=True)
    if report.violations:
        count = len(report.violations)
        console.print(f"[bold red]fails[/]: {count} violation{'s' if count > 1 else ''}")
        console.print(_table("violations", report.violations[:SHOWN_VIOLATIONS]))
        if count > SHOWN_VIOLATIONS:
            console.print(f"and {count - SHOWN_VIOLATIONS} more; --json lists all")
    else:
        console.print("[bold green]passes[/] every constraint")
        limits = [entry for entry in report.worst if entry.amount < 0.0]
        console.print(_table("closest to their limits (negative: slack)", limits[:SHOWN_TIGHTEST]))
    if report.cost is not None:
        console.print(f"cost J {report.cost:.4f}")
    if report.joints:
        console.print(_joint_table(report.actuators or report.joints))
    if report.largest_torque is not None:
        console.print(_torque_line(report.largest_torque), soft_wrap=True)
    if report.correction is not None:
        lack = (
            f"between the knots the wrenches lack up to {report.correction.moment_Nm:.2f} N m about the centre of mass"
        )
        console.print(f"{lack}: the controller adds up to {report.correction.force_N:.1f} N a gripper", soft_wrap=True)
    if report.friction_margin_N is not None:
        margin_N = round(report.friction_margin_N, 2) + 0.0
        squeeze = "" if on_feet else " with the plan's squeeze"
        console.print(f"least margin of the limit surface {margin_N:.2f} N{squeeze}")
    if report.tumble_margin_m is not None:
        console.print(f"least tumble stability margin about the centre of mass {report.tumble_margin_m:.3f} m")
    console.print(f"checked in {report.seconds:.2f} s")


def _table(title: str, entries: list[Violation]) -> Any:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("constraint", "limb", "f.", "time"):
        table.add_column(heading, no_wrap=True)
    table.add_column("beyond by", justify="right", no_wrap=True)
    table.add_column("what")
    for entry in entries:
        table.add_row(
            entry.constraint,
            entry.limb or "",
            "" if entry.finger is None else str(entry.finger),
            "" if entry.time_s is None else f"{entry.time_s:.2f} s",
            f"{entry.amount:.4g} {entry.unit}",
            escape(in_a_line(entry.detail)),
        )
    return table


def _joint_table(loads: list[JointLoad]) -> Any:
    """Torques by limb and joint beside the joint's limits: peak against effort, rms against the advised mean."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    bearer = "actuator" if loads[0].joint.endswith(" (actuator)") else "joint"
    title = f"{bearer} torque, peak/rms in N m against effort/advised mean load, and peak speed in rad/s"
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("limb")
    limbs = list(dict.fromkeys(load.limb for load in loads))
    first = [load for load in loads if load.limb == limbs[0]]
    for load in first:
        name = load.joint.removeprefix(f"{load.limb}_").removesuffix(" (actuator)")
        limits = f"{load.effort_limit_Nm:g}/{load.continuous_limit_Nm:g}"
        table.add_column(f"{name}\n{limits}", justify="right", no_wrap=True)
    table.add_column(f"speed\n{min(load.speed_limit_rad_s for load in first):g}", justify="right", no_wrap=True)
    for limb in limbs:
        row = [load for load in loads if load.limb == limb]
        cells = [f"{load.peak_torque_Nm:.1f}/{_warn(load)}" for load in row]
        table.add_row(limb, *cells, f"{max(load.peak_speed_rad_s for load in row):.2f}")
    return table


def _torque_line(peak: PeakTorque) -> str:
    """What the controller will ask of the hardest-worked joint, marked where that is more than it has."""
    line = (
        f"with the load shared about the true centre of mass, {peak.joint} carries {peak.torque_Nm:.1f} of "
        f"{peak.effort_limit_Nm:g} N m at {peak.time_s:.2f} s"
    )
    return f"[yellow]{line}: it gives way there[/]" if peak.share > 1.0 else line


def _warn(load: JointLoad) -> str:
    """The rms torque, marked where it is above the mean load that makers of such servos advise."""
    text = f"{load.rms_torque_Nm:.1f}"
    return f"[yellow]{text}[/]" if load.rms_torque_Nm > load.continuous_limit_Nm else text
