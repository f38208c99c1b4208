"""`crux upload`, `start`, `hold`, `resume`, `step` …: an operator's words to a runtime."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from crux_contracts.terminal import in_a_line

from crux_tools.arguments import taught
from crux_tools.output import add_json_option, note, print_json

RENEW_S = 3.0  # of a lease of ten
REARM_S = 0.5  # longer than the runtime re-arms nodes


def _add(subparsers: Any, name: str, text: str, example: str, runner: Any) -> argparse.ArgumentParser:
    from crux_tools.key_command import add_key_option
    from crux_tools.operator_link import DEFAULT_URL

    teaching = taught(f"{text}. The runtime listens on the LCM URL it was started with; --lcm names another.", example)
    parser: argparse.ArgumentParser = subparsers.add_parser(name, help=text, **teaching)
    parser.add_argument(
        "--lcm", default=DEFAULT_URL, metavar="URL", help="LCM URL of the runtime (default: %(default)s)"
    )
    if name != "status":
        add_key_option(parser)
    add_json_option(parser)
    parser.set_defaults(func=runner)
    return parser


def _link(options: argparse.Namespace) -> Any:
    from crux_tools.operator_link import OperatorLink

    key = getattr(options, "key", None)  # asking needs none
    return OperatorLink(options.lcm, first_request=time.time_ns(), key=key)  # no runtime has seen this id before


def _report(options: argparse.Namespace, answer: Any) -> int:
    from crux_tools.operator_link import STATES

    state = STATES.get(answer.supervisor_state, f"state {answer.supervisor_state}")
    if options.json:
        print_json({"ok": True, "state": state, "plan_id": answer.plan_id})
    else:
        note(f"runtime: {state}" + (f", plan {in_a_line(answer.plan_id[:12])}" if answer.plan_id else ", no plan"))
    return 0


def _send(options: argparse.Namespace, command: str, value: float = 0.0) -> int:
    from crux_msgs import command_t

    with _link(options) as link:
        return _report(options, link.send(getattr(command_t, command), value=value))


def _send_of_plan(options: argparse.Namespace, command: str) -> int:
    """A command that names the plan it means; without --plan-id the one the runtime reports."""
    from crux_msgs import command_t

    with _link(options) as link:
        plan_id = options.plan_id or link.send(command_t.STATUS).plan_id
        return _report(options, link.send(getattr(command_t, command), plan_id))


def _add_plan_id(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--plan-id", default="", metavar="ID", help="refuse to climb when the runtime holds another plan"
    )


def add_upload_parser(subparsers: Any) -> None:
    """crux upload PLAN.mcap."""
    text = "Send a plan to a running runtime, which checks it against its robot; of a route, each part as it climbs"
    parser = _add(subparsers, "upload", text, "crux upload out/plan.mcap && crux start", run_upload)
    parser.add_argument("plan", type=Path, metavar="PLAN.mcap", help="a plan, or the folder of a route, by crux plan")
    parser.add_argument(
        "--replan",
        action="store_true",
        help="stay beside the climb, and plan the moves ahead again after each new grasp, where holds are not as on "
        "the map; what comes too late or is no plan changes nothing",
    )


def run_upload(options: argparse.Namespace) -> int:
    """Uploads; the runtime's reason when it refuses."""
    from crux_contracts.plan_file import read_plan

    if options.plan.is_dir():
        from crux_tools.errors import UsageError
        from crux_tools.route_upload import upload_route

        if options.replan:
            raise UsageError(f"--replan: {options.plan} is a route in parts; expected one plan")

        with _link(options) as link:
            return _report(options, upload_route(link, options.plan, note))
    plan = read_plan(options.plan)
    with _link(options) as link:
        answer = link.upload(plan)
        if options.replan:
            from crux_tools.guide.replan_command import beside

            answer = beside(link, plan, options.plan)
        return _report(options, answer)


def add_start_parser(subparsers: Any) -> None:
    """crux start."""
    _add_plan_id(_add(subparsers, "start", "Climb the uploaded plan", "crux start", run_start))


def run_start(options: argparse.Namespace) -> int:
    """START."""
    return _send_of_plan(options, "START")


def add_hold_parser(subparsers: Any) -> None:
    """crux hold."""
    _add(subparsers, "hold", "Stop climbing and hold on", "crux hold", run_hold)


def run_hold(options: argparse.Namespace) -> int:
    """HOLD is never refused."""
    return _send(options, "HOLD")


def add_resume_parser(subparsers: Any) -> None:
    """crux resume."""
    _add(subparsers, "resume", "Resume the climb after a hold", "crux resume", run_resume)


def run_resume(options: argparse.Namespace) -> int:
    """RESUME."""
    return _send(options, "RESUME")


def add_step_parser(subparsers: Any) -> None:
    """crux step."""
    text = (
        "Climb to the next stance, with all limbs on holds and bearing load, and hold there. When ready it starts the "
        "plan; while climbing it says where to stop"
    )
    _add_plan_id(_add(subparsers, "step", text, "crux step", run_step))


def run_step(options: argparse.Namespace) -> int:
    """STEP."""
    return _send_of_plan(options, "STEP")


def add_reverse_parser(subparsers: Any) -> None:
    """crux reverse."""
    text = (
        "Climb backward along the plan to the last stance in which all limbs gripped, and hold there; a limb in the "
        "air returns to the hold it came from. Run it again for the stance before; crux resume climbs forward. Refused "
        "unless the robot holds, and for walks"
    )
    _add(subparsers, "reverse", text, "crux reverse", run_reverse)


def run_reverse(options: argparse.Namespace) -> int:
    """REVERSE."""
    return _send(options, "REVERSE")


def add_speed_parser(subparsers: Any) -> None:
    """crux speed."""
    text = (
        "Set how fast the plan is played, forward and backward: 1 as planned, 0 stands still. It lasts until it is set "
        "again. Walks only run at 1"
    )
    parser = _add(subparsers, "speed", text, "crux speed 0.5", run_speed)
    parser.add_argument("scale", type=float, metavar="SCALE", help="from 0 to 1; the runtime refuses any other")


def run_speed(options: argparse.Namespace) -> int:
    """SPEED."""
    return _send(options, "SPEED", options.scale)


def add_clear_parser(subparsers: Any) -> None:
    """crux clear-fault."""
    text = "Leave the fault state once its cause is gone: all faults that stand, or those named, one by one"
    parser = _add(subparsers, "clear-fault", text, "crux clear-fault slip", run_clear)
    parser.add_argument("fault", nargs="*", metavar="FAULT", help="name of a fault, as in crux status (default: all)")


def run_clear(options: argparse.Namespace) -> int:
    """CLEAR_FAULT, which the runtime refuses while the cause stands; then what is left once nodes are re-armed."""
    from crux_contracts.channels import FAULT_BY_CODE
    from crux_msgs import command_t

    from crux_tools.errors import UsageError, WorkFailed
    from crux_tools.operator_status import faults_of

    codes = {kind.name: code for code, kind in FAULT_BY_CODE.items()}
    if unknown := [name for name in options.fault if name not in codes]:
        raise UsageError(f"{unknown[0]}: no fault has that name; crux status has the names of those that stand")
    with _link(options) as link:
        for code in [codes[name] for name in options.fault] or [0]:
            link.send(command_t.CLEAR_FAULT, value=code)
        time.sleep(REARM_S)
        answer = link.send(command_t.STATUS)
        faults = faults_of(link.status)
        if options.fault:
            for fault in faults:
                note(f"stands still: {fault['name']}: {fault['where']}{fault['text']}")
        elif faults:
            raise WorkFailed(f"still: {faults[0]['where']}{faults[0]['text']}; {faults[0]['do']}")
        return _report(options, answer)


def add_shutdown_parser(subparsers: Any) -> None:
    """crux shutdown."""
    text = "Stop the runtime; refused unless it is idle"
    parser = _add(subparsers, "shutdown", text, "crux shutdown", run_shutdown)
    parser.add_argument(
        "--force",
        action="store_true",
        help="stop it even while the robot is on the wall: the nodes then hold by their own watchdogs, with the torque "
        "and squeeze they have, and nothing controls the stance",
    )


def run_shutdown(options: argparse.Namespace) -> int:
    """SHUTDOWN or FORCE_SHUTDOWN: the state in the answer is the last."""
    from crux_msgs import command_t, robot_state_t

    with _link(options) as link:
        answer = link.send(command_t.FORCE_SHUTDOWN if options.force else command_t.SHUTDOWN)
    if options.json:
        print_json({"ok": True, "state": "shut down", "plan_id": answer.plan_id})
    else:
        on_wall = answer.supervisor_state != robot_state_t.IDLE
        note("runtime: shuts down" + ("; the nodes hold by themselves from now on" if on_wall else ""))
    return 0


def add_lease_parser(subparsers: Any) -> None:
    """crux lease."""
    text = (
        "Take exclusive control until Ctrl-C. Every other command takes the lease by itself for ten seconds; run this "
        "beside them to keep it. A hold from another operator is accepted all the same"
    )
    _add(subparsers, "lease", text, "crux lease", run_lease)


def run_lease(options: argparse.Namespace) -> int:
    """Renews the lease until it is interrupted; where the runtime takes commands from everybody there is none."""
    from crux_msgs import acknowledgement_t, command_t

    from crux_tools.errors import WorkFailed

    with _link(options) as link:
        link.send(command_t.STATUS)
        if link.status is not None and link.status.insecure:
            raise WorkFailed("the runtime is insecure: anyone may command it, so there is no lease")
        said = False
        while True:
            answer = link.take_lease()
            if answer is None or answer.verdict != acknowledgement_t.ACCEPTED:
                why = "no runtime answers" if answer is None else in_a_line(answer.reason)
                raise WorkFailed(f"the lease is lost: {why}")
            if not said:
                note("you have the lease, until Ctrl-C")
                said = True
            time.sleep(RENEW_S)


def add_status_parser(subparsers: Any) -> None:
    """crux status."""
    _add(subparsers, "status", "Show the status of the runtime and of each limb", "crux status --json", run_status)


def run_status(options: argparse.Namespace) -> int:
    """STATUS: state, place in the plan, every limb's grip, the fault that stands, and nodes that are missing."""
    from crux_msgs import command_t

    from crux_tools.operator_status import status_json, status_lines

    with _link(options) as link:
        answer = link.send(command_t.STATUS)
        if options.json:
            print_json(status_json(answer, link.status))
        else:
            _report(options, answer)
            for line in status_lines(link.status):
                note(line)
    return 0
