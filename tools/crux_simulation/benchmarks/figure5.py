"""`crux bench fig5`: residuals of both ADMMs on the four-hold climb, the paper's Fig. 5."""

from __future__ import annotations

from crux_contracts.scenario import Scenario

from crux_simulation.benchmarks.residuals import FORCE, MOMENT, ORIENTATION, POSITION, History, ResidualFigure


def _residuals(scenario: Scenario, method: str, iterations: int) -> History:
    from crux_planner.method_report import climb_report

    return climb_report(scenario, method, iterations=iterations, to_the_end=True).decided.history


FIGURE = ResidualFigure("fig5", "climb", "climb-four-holds", (POSITION, FORCE, ORIENTATION, MOMENT), _residuals)
add_arguments, run = FIGURE.add_arguments, FIGURE.run
