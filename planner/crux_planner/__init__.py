"""The planner: from a scenario and a robot description to a checked plan.

Public: `plan`, `Planner` (plans again, warm), `stances` and `scenario_at` of a running plan, `PlanResult` and its
arrays (`PlanSeries`), `Faces` (where pads meet a hold), `InfeasibleError`, and the modules `checker`, `cli` (of
`crux plan`), `errors` and `method_report` (the paper's methods by themselves, for measuring). Names are imported when
first used, so that the checker and the command line do not wait for the optimisation libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crux_contracts.plan_series import PlanSeries

    from crux_planner.errors import InfeasibleError
    from crux_planner.model.faces import Faces
    from crux_planner.pipeline.entry import plan
    from crux_planner.pipeline.message import PlanResult
    from crux_planner.pipeline.replan import Planner
    from crux_planner.pipeline.restart import scenario_at, stances

__all__ = ["Faces", "InfeasibleError", "PlanResult", "PlanSeries", "Planner", "plan", "scenario_at", "stances"]

_HOME = {
    "Faces": "crux_planner.model.faces",
    "InfeasibleError": "crux_planner.errors",
    "PlanResult": "crux_planner.pipeline.message",
    "PlanSeries": "crux_contracts.plan_series",
    "Planner": "crux_planner.pipeline.replan",
    "plan": "crux_planner.pipeline.entry",
    "scenario_at": "crux_planner.pipeline.restart",
    "stances": "crux_planner.pipeline.restart",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
