"""Why a plan cannot be made."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crux_contracts.scenario import Scenario, ScenarioError


class InfeasibleError(Exception):
    """The scenario is well formed, but some constraint cannot be met; str() says which one and where.

    `proven`: no plan exists; else none was found.
    """

    def __init__(self, constraint: str, message: str, *, proven: bool = False) -> None:
        super().__init__(message)
        self.constraint = constraint
        self.proven = proven


TIME_LIMIT = "time limit"


def unsolved(gait: str, status: str) -> InfeasibleError:
    """Why the exact problem of a gait was left without a solution; `status` is the solver's."""
    if "Time" in status:
        return InfeasibleError(
            TIME_LIMIT, f"no time was left for the exact problem of the gait {gait}; allow more with --time-limit"
        )
    return InfeasibleError("dynamics", f"the exact problem has no solution for the gait {gait} ({status})")


class LevelGoalError(InfeasibleError):
    """A level body at the very goal has no hold in reach: said of that pose, not of all that the tolerances allow."""


def wrong(scenario: Scenario, key: str, value: str, expected: str) -> ScenarioError:
    """The error for a scenario whose author must mend `key`."""
    from crux_contracts.scenario import ScenarioError
    from crux_contracts.yaml_document import Problem

    return ScenarioError(scenario.path, [Problem(key, value, expected)])
