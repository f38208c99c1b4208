"""The planner: from a scenario and a robot description to a checked plan.

Public: `plan`, `Planner` (plans again, warm), `PlanResult`, `InfeasibleError`, and the modules `checker`, `replanning`,
`errors` and `alone` (the paper's methods by themselves, for measuring). Names
are imported when first used, so that the checker and the command line do not wait for the optimisation libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crux_planner.entry import plan
    from crux_planner.errors import InfeasibleError
    from crux_planner.replanning import Planner
    from crux_planner.result import PlanResult

__all__ = ["InfeasibleError", "PlanResult", "Planner", "plan"]

_HOME = {"InfeasibleError": "errors", "PlanResult": "result", "Planner": "replanning", "plan": "entry"}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
