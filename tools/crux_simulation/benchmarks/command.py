"""`crux bench NAME`: each bench is a module with add_arguments(parser) and run(options) -> exit status."""

from __future__ import annotations

import argparse
import importlib
from dataclasses import dataclass
from typing import Any

from crux_tools.arguments import taught
from crux_tools.errors import WorkFailed
from crux_tools.output import add_json_option, note


@dataclass(frozen=True)
class Bench:
    """A bench: what it does, the module that does it, and how it is called, for example."""

    help: str
    module: str
    options: str = ""


_HERE = "crux_simulation.benchmarks"
BENCHES = {
    "table2": Bench(
        "time every method on the paper's two tasks, ten pairs each", f"{_HERE}.table2", "--count 3 --methods auto"
    ),
    "table3": Bench("slips of a finger that was planned with and without the patch constraint", f"{_HERE}.table3"),
    "fig4": Bench("residuals of the ADMMs on a walk over their iterations", f"{_HERE}.figure4"),
    "fig5": Bench("residuals of the ADMMs on a climb over their iterations", f"{_HERE}.figure5"),
    "fig6": Bench("the gait with and without moments in the contact block", f"{_HERE}.figure6"),
    "fig7": Bench("the faces that are gripped where others are slippery", f"{_HERE}.slippery"),
    "fig8": Bench("shear of a finger at zero normal force", f"{_HERE}.spines"),
    "fig9": Bench(
        "planned and measured wrench with fixed and with calibrated gains, on holds that give",
        f"{_HERE}.figure9",
        "--stiffnesses 2e4 inf",
    ),
    "fields": Bench(
        "decide random hold fields: solved, or proven infeasible",
        f"{_HERE}.hold_fields",
        "--count 5 --seed 101",
    ),
    "walls": Bench(
        "plan and climb walls of edges, corners, boards and boulders", f"{_HERE}.many_walls", "my-wall.yaml --limit 30"
    ),
    "routes": Bench(
        "plan routes over 16 to 100 holds, with CPU time and J",
        f"{_HERE}.routes",
        "--rungs 8 --seed 2",
    ),
    "scenes": Bench("plan, check and climb every scene that ships", f"{_HERE}.scenes", "climb-vertical walk-flat"),
    "pace": Bench("climb for the least J, in the least time, and in between", f"{_HERE}.paces", "climb-vertical"),
    "fast": Bench(
        "plan random walls for the least time and climb them, as planned and in drawn worlds",
        f"{_HERE}.fast_climbs",
        "--count 8 --seed 9001",
    ),
    "replan": Bench(
        "plan again, warm, from every stance of a route over sixteen holds", f"{_HERE}.replans", "--walls 0 --plain"
    ),
    "loop": Bench(
        "climb on holds that are off the map, without and with planning again on the way",
        f"{_HERE}.replanned_climbs",
        "--count 3 --scenario msgs/scenarios/climb-vertical.yaml",
    ),
    "worlds": Bench("climb in worlds with all ordinary errors at once", f"{_HERE}.worlds", "--count 10 --seed 7"),
    "faults": Bench(
        "break the buses in mid-climb in every way and time the hold", f"{_HERE}.bus_faults", "--kinds cut reset"
    ),
    "guide": Bench(
        "let holds and sensors fail with the guide beside, and count how the robot goes on",
        f"{_HERE}.guided_climbs",
        "--count 3 --kinds hold-breaks",
    ),
    "uncertainty": Bench(
        "climb drawn worlds with the usual plan and with one that is made for them", f"{_HERE}.uncertainty", "--count 5"
    ),
    "view": Bench("open an hour's log in the viewer, and scrub it in Chromium", f"{_HERE}.long_view", "--minutes 10"),
    "firmware": Bench("count what the images' interrupts execute, against their time", f"{_HERE}.firmware_cost"),
}


def add_parser(subparsers: Any) -> None:
    """Adds `crux bench` with one sub-command a bench, and `all`."""
    parser = subparsers.add_parser(
        "bench",
        help="reproduce a figure of merit",
        **taught(
            "Reproduces a figure of merit; exit status 1 when it is missed.",
            "crux bench fig6",
            "crux bench table2 --count 3 --methods auto",
        ),
    )
    names = parser.add_subparsers(dest="bench", metavar="NAME", required=True)
    for name, bench in BENCHES.items():
        example = f"crux bench {name} {bench.options}".strip()
        one = names.add_parser(name, help=bench.help, **taught(bench.help[0].upper() + bench.help[1:] + ".", example))
        importlib.import_module(bench.module).add_arguments(one)
        add_json_option(one)
        one.set_defaults(func=run)
    teaching = taught("Every benchmark, one by one.", "crux bench all")
    everything = names.add_parser("all", help="every benchmark with its defaults", **teaching)
    add_json_option(everything)
    everything.set_defaults(func=run)


def _run_one(name: str, options: argparse.Namespace) -> int:
    return int(importlib.import_module(BENCHES[name].module).run(options))


def _defaults(name: str, as_json: bool) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    importlib.import_module(BENCHES[name].module).add_arguments(parser)
    return argparse.Namespace(**vars(parser.parse_args([])), json=as_json)


def run(options: argparse.Namespace) -> int:
    """Exit status of the bench; of `all` the worst."""
    if options.bench != "all":
        return _run_one(options.bench, options)
    worst = 0
    for name in BENCHES:
        note(f"bench {name}")
        try:
            worst = max(worst, _run_one(name, _defaults(name, options.json)))
        except WorkFailed as error:
            note(f"crux bench {name}: {error}")
            worst = max(worst, 1)
    return worst
