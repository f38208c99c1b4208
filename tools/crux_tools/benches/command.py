"""`crux bench NAME`: each bench is a module with add_arguments(parser) and run(options) -> exit status."""

from __future__ import annotations

import argparse
import importlib
from typing import Any

from crux_tools.output import add_json_option, note

BENCHES = {
    "table2": ("time every method on the paper's two tasks, ten pairs each", "crux_tools.benches.table2"),
    "faults": ("break the buses in mid-climb in every way and time the hold", "crux_tools.benches.bus_faults"),
    "firmware": ("count what the images' interrupts execute, against their time", "crux_tools.benches.firmware_cost"),
    "climbs": ("plan and climb random walls like the four-hold scene", "crux_tools.benches.random_climbs"),
    "costs": ("the cost J of auto and of two-block ADMM on pairs of start and goal", "crux_tools.benches.costs"),
    "replan": ("plan again, warm, from every stance of a route over sixteen holds", "crux_tools.benches.replans"),
    "scenes": ("plan, check and climb every scene that ships", "crux_tools.benches.scenes"),
    "fig7": ("the faces that are gripped where others are slippery", "crux_tools.benches.slippery"),
    "fig8": ("shear of a finger at zero normal force", "crux_tools.benches.spines"),
    "fields": ("decide random hold fields: solved, or proven infeasible", "crux_tools.benches.hold_fields"),
    "fig4": ("residuals of the ADMMs on a walk over their iterations", "crux_tools.benches.figure4"),
    "fig5": ("residuals of the ADMMs on a climb over their iterations", "crux_tools.benches.figure5"),
    "fig6": ("the gait with and without moments in the contact block", "crux_tools.benches.figure6"),
}


def add_parser(subparsers: Any) -> None:
    """Adds `crux bench` with one sub-command a bench, and `all`."""
    parser = subparsers.add_parser(
        "bench",
        help="reproduce a figure of merit",
        description="Reproduces a figure of merit; exit status 1 when it is missed.",
    )
    names = parser.add_subparsers(dest="bench", metavar="NAME", required=True)
    for name, (text, module) in BENCHES.items():
        bench = names.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        importlib.import_module(module).add_arguments(bench)
        add_json_option(bench)
        bench.set_defaults(func=run)
    everything = names.add_parser("all", help="every bench with its defaults", description="Every bench, one by one.")
    add_json_option(everything)
    everything.set_defaults(func=run)


def _run_one(name: str, options: argparse.Namespace) -> int:
    return int(importlib.import_module(BENCHES[name][1]).run(options))


def _defaults(name: str, as_json: bool) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    importlib.import_module(BENCHES[name][1]).add_arguments(parser)
    return argparse.Namespace(**vars(parser.parse_args([])), json=as_json)


def run(options: argparse.Namespace) -> int:
    """Exit status of the bench; of `all` the worst."""
    if options.bench != "all":
        return _run_one(options.bench, options)
    worst = 0
    for name in BENCHES:
        note(f"bench {name}")
        worst = max(worst, _run_one(name, _defaults(name, options.json)))
    return worst
