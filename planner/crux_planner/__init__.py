"""The planner: from a scenario and a robot description to a checked plan.

Public: `plan`, `Planner` (plans again, warm), `stances` and `scenario_at` of a running plan, `PlanResult`,
`InfeasibleError`, and the modules `checker`, `errors` and `method_report` (the paper's methods by themselves, for
measuring). Names are imported when first used, so that the checker and the command line do not wait for the
optimisation libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crux_planner.errors import InfeasibleError
    from crux_planner.pipeline.entry import plan
    from crux_planner.pipeline.message import PlanResult
    from crux_planner.pipeline.replan import Planner
    from crux_planner.pipeline.restart import scenario_at, stances

__all__ = ["InfeasibleError", "PlanResult", "Planner", "plan", "scenario_at", "stances"]

_HOME = {
    "InfeasibleError": "errors",
    "PlanResult": "pipeline.message",
    "Planner": "pipeline.replan",
    "plan": "pipeline.entry",
    "scenario_at": "pipeline.restart",
    "stances": "pipeline.restart",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
