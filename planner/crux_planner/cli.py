"""`crux plan SCENARIO -o PLAN.mcap`: plans, checks, and writes only what passes the check."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_contracts.terminal import plain, say

if TYPE_CHECKING:
    from crux_contracts.robot import Robot
    from crux_contracts.scenario import Scenario

    from crux_planner.errors import InfeasibleError
    from crux_planner.pipeline.message import PlanResult

DONE, FAILED, USAGE, NO_CERTIFICATE = 0, 1, 2, 3

EPILOG = """examples:
  crux plan msgs/scenarios/climb-four-holds.yaml -o out/plan.mcap
  crux plan msgs/scenarios/walk-flat.yaml -o out/walk.mcap --method two_block --time-limit 30
  crux plan msgs/scenarios/climb-four-holds.yaml -o out/again.mcap --from out/plan.mcap --at 20
  crux plan msgs/scenarios/climb-long.yaml -o out/route --stream

exit status: 0 the plan is written, 1 there is none (the message says which constraint cannot be met,
and where, or "undecided": time ran out first), 2 the scenario or the usage is wrong, 3 the plan is written,
but not the certificate that was asked for (the message says why)"""


def add_plan_parser(subparsers: Any) -> None:
    """Add `plan` to the subcommands of crux."""
    from crux_contracts.scenario_types import METHODS, OBJECTIVES

    from crux_planner.method_report import METHODS_HERE
    from crux_planner.pipeline.session import LONGER_S, TIME_LIMIT_S

    parser = subparsers.add_parser(
        "plan",
        help="plan a climb for a scenario",
        description="Plan a climb, check it independently and write it; a plan that fails the check is not written.",
        epilog=f"{METHODS_HERE}\n\n{EPILOG}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="a scenario file (YAML)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PLAN.mcap", help="where the plan goes")
    add = parser.add_argument
    add("--method", choices=METHODS, metavar="M", help=f"{', '.join(METHODS)}; default: the scenario's, else auto")
    limit = "limit on CPU time [s], worker processes included"
    usual = f"default: the scenario's planner.time_limit_s, else {TIME_LIMIT_S:g}"
    usual += "".join(f"; {method}: {limit_s:g}" for method, limit_s in LONGER_S.items())
    add("--time-limit", type=_positive, metavar="S", help=f"{limit}; {usual}")
    pace = "on climbs: the least J (paper), the least time (time), or in between (balanced); default: the scenario's"
    add("--objective", choices=OBJECTIVES, metavar="O", help=f"{pace}, else paper")
    prove = "on climbs: spend up to S more seconds of CPU time on a tighter gap (default: a fixed amount of work)"
    add("--prove", type=_positive, metavar="S", help=prove)
    proofs = (
        "on climbs: write a proof that no plan exists, or that none with the same number of steps costs less than a "
    )
    proofs += "bound; crux check verifies it. Not every proof can be written"
    add("--certificate", type=Path, metavar="FILE", help=proofs)
    add("--from", dest="running", type=Path, metavar="PLAN.mcap", help="plan again from a stance of this plan")
    add("--at", type=_seconds, metavar="S", help="with --from: the first stance from then on (default: 0)")
    lost = "with --from: a hold that is lost (repeatable)"
    add("--without", action="append", default=[], metavar="HOLD", help=lost)
    parts = (
        "on climbs of any length: plan part after part of the way, from stance to stance, and write each as soon as "
    )
    parts += "it is checked: -o is a folder that takes 00000.mcap, 00001.mcap, ..."
    add("--stream", action="store_true", help=parts)
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object on standard output")
    parser.set_defaults(func=run_plan)


def run_plan(args: argparse.Namespace) -> int:
    """Run the command; returns the exit status."""
    from crux_contracts.output_file import OutputError, look_at_outputs
    from crux_contracts.plan_file import PlanFileError, read_plan, write_plan
    from crux_contracts.robot import load_robot
    from crux_contracts.scenario import load_scenario
    from crux_contracts.yaml_document import DocumentError

    from crux_planner.errors import InfeasibleError

    if lone := _astray(args):
        return _fail(args, lone, USAGE)
    try:
        scenario = _at_pace(args, load_scenario(args.scenario))
        robot = load_robot(scenario.robot)
        if args.stream:
            return _stream(args, scenario, robot)
        look_at_outputs({"-o": args.output, "--certificate": args.certificate}, (args.scenario, args.running))
        with _progress() as (report, log):
            if args.running is not None or scenario.start.air:
                from crux_planner.pipeline.replan import Planner

                again = Planner(scenario, robot)
                limit = {} if args.time_limit is None else {"time_limit_s": args.time_limit}
                if args.running is None:
                    result = again.plan(log=log, **limit)
                else:
                    running = read_plan(args.running)
                    result = again.replan(running, args.at or 0.0, without=args.without, log=log, **limit)
            else:
                from crux_planner.pipeline.entry import plan

                result = plan(
                    scenario,
                    robot,
                    method=args.method or scenario.planner.method,
                    time_limit_s=args.time_limit,
                    prove_s=args.prove,
                    progress=report,
                    log=log,
                )
        write_plan(args.output, result.plan)
    except InfeasibleError as error:
        message = f"{args.scenario}: {error.verdict} ({error.constraint}): {error}"
        if args.certificate is not None:
            message += f"\n{_certify(args.certificate, scenario, robot, error)}"
        return _fail(args, message, FAILED, **error.to_json())
    except (DocumentError, OutputError, PlanFileError) as error:
        return _fail(args, str(error), USAGE)
    except OSError as error:
        return _fail(args, f"{error.filename or args.scenario}: {error.strerror or error}", USAGE)
    if not args.json:
        _show(result, args.output)
    written: dict[str, Any] = {"plan": str(args.output), "plan_id": result.plan.plan_id}
    if args.certificate is not None:
        written["certified_bound"], said = _certify_bound(args.certificate, scenario, robot, result)
        say(f"crux plan: {said}", to_errors=True)
    if args.json:
        print(json.dumps({**result.to_json(), **written}))
    return NO_CERTIFICATE if args.certificate is not None and written["certified_bound"] is None else DONE


def _stream(args: argparse.Namespace, scenario: Scenario, robot: Robot) -> int:
    """Write the parts of a route into a folder. Raises as planning and writing do."""
    from crux_contracts.output_file import OutputError, look_at_folder
    from crux_contracts.plan_file import write_plan
    from crux_contracts.plan_route import part_path

    from crux_planner.errors import wrong
    from crux_planner.pipeline.route import plan_route

    look_at_folder("-o", args.output)
    if part_path(args.output, 0).exists():
        raise OutputError(f"-o {args.output}: has a route in it; name another folder")
    if partly := [hold.name for hold in scenario.holds if min(hold.pad_share) < 1.0]:
        why = "parts of a route do not have the holds of those before; expected whole pads"
        raise wrong(scenario, "holds", f"pads bear in part on {partly[0]}", why)
    limit = {} if args.time_limit is None else {"time_limit_s": args.time_limit}
    parts = []
    for number, result in enumerate(plan_route(scenario, robot, log=lambda line: say(line, to_errors=True), **limit)):
        path = part_path(args.output, number)
        write_plan(path, result.plan)
        parts.append({"plan": str(path), "plan_id": result.plan.plan_id, **result.to_json()})
        x, y, _ = result.plan.knots[-1].body_position_w_m
        if not args.json:
            say(
                f"{path}: to ({x:.2f}, {y:.2f}) m, gait {' '.join(result.gait)}, {result.plan.knots[-1].time_s:.1f} s; "
                f"computed for {result.computed_s:.2f} s"
            )
    if args.json:
        print(json.dumps({"ok": True, "parts": parts}))
    return DONE


def _certify(path: Path, scenario: Scenario, robot: Robot, error: InfeasibleError) -> str:
    """Write the certificate of a proof, if it has one; what to say of it."""
    from crux_planner.pipeline.certificates import certify_no_plan

    if not error.proven:
        return "no certificate: nothing is proven"
    document = certify_no_plan(scenario, robot)
    if document is None:
        return "no certificate for this kind of proof: the checker cannot show it by bounds of its own"
    failed = _written(path, document)
    return failed or f"{path}: certificate that crux check accepts no plan; crux check {path} verifies it"


def _certify_bound(path: Path, scenario: Scenario, robot: Robot, result: PlanResult) -> tuple[float | None, str]:
    """Write the certificate of a bound of J, if there is one; the bound, and what to say of it."""
    from crux_planner.checker.no_way import NotShownError
    from crux_planner.checker.outer import OutsideError
    from crux_planner.pipeline.bound_certificate import certify_bound

    try:
        cost = result.cost if result.check.cost is None else result.check.cost
        document = certify_bound(scenario, robot, result.steps, cost)
    except (NotShownError, OutsideError) as error:
        return None, f"no certificate of a bound: {error}"
    failed = _written(path, document)
    if failed:
        return None, failed
    bound = float(document["bound"])
    said = f"{path}: certificate that no plan of {result.steps} steps that crux check accepts costs less than "
    said += f"{bound:.4f}, where this one costs {cost:.4f}; crux check {path} verifies it"
    if result.gap is not None:
        own = (1.0 - result.gap) * result.cost
        said += f"\ncrux plan: the planner's own bound, {own:.4f}, is about its own swings and places on the holds; "
        said += "the certificate's is about all plans that crux check accepts for this scenario"
    return bound, said


def _written(path: Path, document: dict[str, Any]) -> str:
    """Write a certificate; why not, if not."""
    from crux_contracts.output_file import write_whole

    try:
        write_whole(path, f"{json.dumps(document)}\n".encode())
    except OSError as failed:
        return f"no certificate: {path}: cannot be written: {failed.strerror}"
    return ""


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number of seconds")
    return value


def _positive(text: str) -> float:
    value = _seconds(text)
    if value == 0.0:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number of seconds above 0")
    return value


def _astray(args: argparse.Namespace) -> str:
    """What is wrong with the options as a whole: those of planning again need --from, others go with neither it nor
    --stream.
    """
    if args.stream:
        given = {"--from": args.running, "--method": args.method, "--prove": args.prove}
        given = {name: value is not None for name, value in {**given, "--certificate": args.certificate}.items()}
        reason = "does not go with --stream"
    elif args.running is None:
        given = {"--at": args.at is not None, "--without": bool(args.without)}
        reason = "is about a plan that runs: give it by --from PLAN.mcap"
    else:
        given = {"--method": args.method, "--prove": args.prove, "--certificate": args.certificate}
        given = {name: value is not None for name, value in given.items()}
        reason = "does not go with --from, which always keeps to the running plan where it can"
    return "; ".join(f"{name} {reason}" for name, is_given in given.items() if is_given)


def _at_pace(args: argparse.Namespace, scenario: Scenario) -> Scenario:
    from crux_planner.pipeline.restart import with_objective

    if args.objective is None:
        return scenario
    if scenario.contact.model == "point":
        say(f"crux plan: {args.scenario} is a walk, and walks have even steps: --objective is left out", to_errors=True)
        return scenario
    return with_objective(scenario, args.objective)


def _fail(args: argparse.Namespace, message: str, status: int, **more: Any) -> int:
    for line in message.splitlines():
        say(f"crux plan: {line}", to_errors=True)
    if args.json:
        print(json.dumps({"ok": False, "error": message, **more}))
    return status


def _show(result: PlanResult, output: Path) -> None:
    from crux_contracts.interpolation import is_walk

    seconds = result.plan.knots[-1].time_s
    say(
        f"{output}: {result.plan.scenario_name!r}, gait {' '.join(result.gait) or 'without a step'}, "
        f"{result.steps} steps, {seconds:g} s"
    )
    margin = result.check.friction_margin_N
    parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in result.timing.items())
    say(f"planned and checked in {result.seconds:.2f} s by the clock ({parts})")
    say(f"computed for {result.computed_s:.2f} s, which --time-limit counts (CPU time, workers included)")
    say(f"{result.iterations} iterations, cost {result.cost:.3f}")
    if result.others is not None:
        say(str(result.others))
    if result.gap is not None:
        proven = f"proven {result.scope}: no plan of {result.steps} steps costs less than"
        say(f"{proven} {100 * (1 - result.gap):.0f} % of that")
    if result.nominal_cost is not None:
        less = 100 * (1 - result.nominal_cost / result.cost)
        say(f"holds for all of the scenario's uncertainty; the same contacts cost {less:.0f} % less without it")
    if margin is not None:
        pressed = " with the planned squeeze; the controller squeezes at least this hard"
        squeeze = "" if is_walk(result.plan) else pressed
        say(f"least margin of the limit surface {round(margin, 2) + 0.0:.2f} N{squeeze}")


@contextmanager
def _progress() -> Iterator[tuple[Callable[[str, float], None] | None, Callable[[str], None]]]:
    """A progress bar on standard error where that is a terminal, and how to print a line beside it."""
    if not sys.stderr.isatty():
        yield None, lambda line: say(line, to_errors=True)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("planning", total=1.0)
        yield (
            lambda what, share: bar.update(task, completed=share, description=f"planning: {what}"),
            lambda line: bar.console.print(plain(line), highlight=False, markup=False),
        )
