"""`crux bench fig4`: residuals of two-block and five-block ADMM on a walk, the paper's Fig. 4."""

from __future__ import annotations

import argparse
from pathlib import Path

from crux_tools.benches.residuals import FORCE, POSITION, draw, print_table, summary
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS

PANELS = (POSITION, FORCE)  # point feet: no finger turns, none carries a moment
ITERATIONS = {"two_block": 10, "multi_block": 30}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fig4`."""
    parser.add_argument(
        "--scenario",
        type=Path,
        default=SCENARIOS / "walk-flat.yaml",
        metavar="FILE",
        help="another walk (default: walk-flat)",
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/fig4.png"), metavar="PNG", help="picture (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when both end within the paper's thresholds."""
    from crux_contracts.scenario import load_scenario
    from crux_planner.alone import walk_residuals

    scenario = load_scenario(options.scenario)
    histories = {
        method: walk_residuals(scenario, method, iterations=iterations, to_the_end=True)
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
