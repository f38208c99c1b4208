"""`crux bench fig5`: residuals of two-block and five-block ADMM on the four-hold climb, the paper's Fig. 5."""

from __future__ import annotations

import argparse
from pathlib import Path

from crux_tools.benches.residuals import FORCE, MOMENT, ORIENTATION, POSITION, draw, print_table, summary
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS

PANELS = (POSITION, FORCE, ORIENTATION, MOMENT)
ITERATIONS = {"two_block": 10, "multi_block": 30}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fig5`."""
    parser.add_argument(
        "--scenario",
        type=Path,
        default=SCENARIOS / "climb-four-holds.yaml",
        metavar="FILE",
        help="another climb (default: climb-four-holds)",
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/fig5.png"), metavar="PNG", help="picture (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when both end within the paper's thresholds."""
    from crux_contracts.scenario import load_scenario
    from crux_planner.alone import climb_alone

    scenario = load_scenario(options.scenario)
    histories = {
        method: climb_alone(scenario, method, iterations=iterations, to_the_end=True).decided.residuals
        for method, iterations in ITERATIONS.items()
    }
    draw(options.output, f"Residuals over the iterations: {scenario.name}", histories, PANELS)
    result = summary(histories, options.output)
    if options.json:
        print_json(result)
    else:
        print_table(histories, PANELS)
        note(f"picture: {options.output}")
    return 0 if result["ok"] else 1
