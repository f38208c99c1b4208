"""The `crux` command. Each subcommand lives in a module of its own, imported only when it is called."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import sys
import traceback
from collections.abc import Container, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from crux_contracts.terminal import say

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import note, print_json
from crux_tools.paths import CHECKOUT, SCENARIOS, SCHEMAS, how_to_add, version_and_requirements

DONE, FAILED, USAGE = 0, 1, 2
INTERRUPTED = 130


@dataclass(frozen=True)
class Command:
    """Where a subcommand lives: `adder` puts its parser among the others and sets the default `func`.

    A command that reads `logs` computes with whatever sensors measured, without a warning where numbers overflow.
    """

    help: str
    module: str
    adder: str = "add_parser"
    runner: str = "run"
    logs: bool = False


_OPERATOR = "crux_tools.operator_commands"
COMMANDS: dict[str, Command] = {
    "demo": Command("plan a wall of four holds and climb it in simulation", "crux_simulation.sim.demo_command"),
    "plan": Command("plan a climb for a scenario", "crux_tools.guide.plan_command"),
    "check": Command(
        "check a plan independently of the planner", "crux_planner.checker.cli", "add_check_parser", "run_check"
    ),
    "climb": Command("run a plan in the hardware-in-the-loop simulation", "crux_simulation.sim.climb_command"),
    "sim": Command("simulate a robot to practise with", "crux_simulation.sim.practice"),
    "campaign": Command("plan and climb thousands of walls in parallel", "crux_simulation.campaign.command"),
    "upload": Command("send a plan to a running runtime", _OPERATOR, "add_upload_parser", "run_upload"),
    "start": Command("let the runtime climb the uploaded plan", _OPERATOR, "add_start_parser", "run_start"),
    "hold": Command("stop climbing and hold on", _OPERATOR, "add_hold_parser", "run_hold"),
    "resume": Command("go on after a hold", _OPERATOR, "add_resume_parser", "run_resume"),
    "step": Command("climb to the next stance and hold there", _OPERATOR, "add_step_parser", "run_step"),
    "reverse": Command("climb back to the last stance", _OPERATOR, "add_reverse_parser", "run_reverse"),
    "speed": Command("set the playback speed of the plan, 0 to 1", _OPERATOR, "add_speed_parser", "run_speed"),
    "clear-fault": Command("leave the fault state once its cause is gone", _OPERATOR, "add_clear_parser", "run_clear"),
    "shutdown": Command(
        "stop the runtime (--force: even while it holds the robot)", _OPERATOR, "add_shutdown_parser", "run_shutdown"
    ),
    "status": Command("show the runtime's status", _OPERATOR, "add_status_parser", "run_status"),
    "lease": Command("take exclusive control", _OPERATOR, "add_lease_parser", "run_lease"),
    "key": Command("manage your signing key", "crux_tools.key_command"),
    "guide": Command("plan again where the robot holds, and go on", "crux_tools.guide.command"),
    "view": Command("show a log or a plan in the browser", "crux_tools.view.command", logs=True),
    "watch": Command("show a running climb in the browser", "crux_tools.view.command", "add_watch_parser", "run_watch"),
    "replay": Command("show a logged climb", "crux_tools.replay.command", logs=True),
    "report": Command(
        "write one HTML page about a plan, a climb or a campaign", "crux_tools.report.command", logs=True
    ),
    "log": Command("list, cut, merge, recover, play and convert logs", "crux_tools.log.command", logs=True),
    "can": Command("set up and check CAN interfaces, or run a kernel that has them", "crux_tools.can.command"),
    "robot": Command("bring a robot in, check what it can do, and look at it", "crux_tools.robot.command"),
    "wall": Command("draw a wall, make one of a scan, and check what it offers", "crux_simulation.wall.command"),
    "preflight": Command("check whether this machine is fit to run a robot", "crux_tools.preflight.command"),
    "bench": Command("reproduce a figure of merit", "crux_simulation.benchmarks.command"),
    "completion": Command("print a script that completes this command in a shell", "crux_tools.completion"),
}
EPILOG = f"""a first climb, and the same step by step:
  crux demo
  crux plan {SCENARIOS}/climb-four-holds.yaml -o out/plan.mcap
  crux check out/plan.mcap
  crux climb out/plan.mcap -o out/climb.mcap
  crux report out/climb.mcap -o out/climb.html

completion and checks in an editor, by the first line of robot.yaml, or scenario.json by that of a scenario:
  # yaml-language-server: $schema={SCHEMAS}/robot.json

exit status: 0 done, 1 the work failed (infeasible, unsafe, fell, differs), 2 the input or the usage is wrong"""


class _Version(argparse.Action):
    """--version: of the sources, and the commit that was built; read only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        try:
            commit = str(importlib.import_module("crux_commit").COMMIT)
        except ModuleNotFoundError:
            commit = "unknown, not built yet"
        say(f"crux {version_and_requirements()[0]} (commit {commit})")
        parser.exit()


def parser_with(chosen: Container[str]) -> argparse.ArgumentParser:
    """The parser of `crux`; only the chosen commands are imported and have their options."""
    parser = argparse.ArgumentParser(
        prog="crux",
        description="Plan and run climbs of limbed robots with grippers.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and the commit that was built")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, command in COMMANDS.items():
        if name in chosen:
            module = importlib.import_module(command.module)
            getattr(module, command.adder)(subparsers)
        else:
            subparsers.add_parser(name, help=command.help)
    return parser


def _error(command: str, text: str, as_json: bool, status: int) -> int:
    lines = [" ".join(line.split()) for line in text.splitlines()]
    for line in lines:
        note(f"crux {command}: {line}" if command else f"crux: {line}")
    if as_json:
        print_json({"ok": False, "error": "\n".join(lines)})
    return status


def _origin(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "unknown place"


WRONG_INPUT = {
    "crux_contracts.yaml_document": "DocumentError",
    "crux_contracts.plan_file": "PlanFileError",
    "crux_contracts.output_file": "OutputError",
    "crux_tools.telemetry.channels": "LogError",
}
NO_SUCCESS = {"crux_planner.errors": "InfeasibleError"}


def _imported(names: dict[str, str]) -> tuple[type[BaseException], ...]:
    """Error types of the other rooms, by module; only those already imported can have been raised."""
    return tuple(getattr(sys.modules[module], name) for module, name in names.items() if module in sys.modules)


def _print_any_text() -> None:
    """Signs that the terminal's encoding does not have, or a path of no valid text, are printed as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `crux`; returns the exit status."""
    _print_any_text()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: further threads of numpy's only spin
    words = list(sys.argv[1:] if arguments is None else arguments)
    chosen = words[0] if words and words[0] in COMMANDS else ""
    as_json = "--json" in words[: words.index("--") if "--" in words else len(words)]
    try:
        options = parser_with({chosen}).parse_args(words)
        run = getattr(importlib.import_module(COMMANDS[chosen].module), COMMANDS[chosen].runner)
        with importlib.import_module("numpy").errstate(all="ignore") if COMMANDS[chosen].logs else nullcontext():
            return int(run(options))
    except KeyboardInterrupt:
        return _error(chosen, "interrupted", as_json, INTERRUPTED)
    except BrokenPipeError:
        return FAILED
    except WorkFailed as error:
        return _error(chosen, str(error), as_json, FAILED)
    except OSError as error:
        return _error(chosen, f"{error.filename}: {error.strerror}" if error.filename else str(error), as_json, USAGE)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and not (CHECKOUT and str(error.name).startswith("crux_")):
            text = f"needs {error.name}, which is not installed: {how_to_add(str(error.name))}"
            return _error(chosen, text, as_json, USAGE)
        if isinstance(error, (UsageError, *_imported(WRONG_INPUT))):
            return _error(chosen, str(error), as_json, USAGE)
        if isinstance(error, _imported(NO_SUCCESS)):
            return _error(chosen, str(error), as_json, FAILED)
        text = f"internal error, please report it: {type(error).__name__}: {error} (at {_origin(error)})"
        return _error(chosen, text, as_json, FAILED)


if __name__ == "__main__":
    sys.exit(main())
