"""`crux bench fig4`: residuals of both ADMMs on a walk, the paper's Fig. 4."""

from __future__ import annotations

from crux_contracts.scenario import Scenario

from crux_simulation.benchmarks.residuals import FORCE, POSITION, History, ResidualFigure


def _residuals(scenario: Scenario, method: str, iterations: int) -> History:
    from crux_planner.method_report import walk_residuals

    return walk_residuals(scenario, method, iterations=iterations, to_the_end=True)


# Point feet: no finger turns, none carries a moment.
FIGURE = ResidualFigure("fig4", "walk", "walk-flat", (POSITION, FORCE), _residuals)
add_arguments, run = FIGURE.add_arguments, FIGURE.run
