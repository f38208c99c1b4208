"""Why a plan cannot be made."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from crux_contracts.scenario import Scenario, ScenarioError


TIME_LIMIT = "time limit"
FOR_ALL_REACH = "for all that the limbs reach"
"""What proofs and bounds of climbs are about: every place up to the joint limits, more than plans use."""
FOR_ITS_REACH = "for the reach it plans with"
"""What bounds of walks are about: the acceptance boxes (9a), which lie inside of what the limbs reach."""
PLANNED_REACH = "the reach that crux plans with"
"""Inner sets of (9a), with a margin to the joint limits: what is beyond them may still be within a limb's reach."""


class InfeasibleError(Exception):
    """The scenario is well formed, but there is no plan; str() says which constraint cannot be met, and where.

    `proven`: no plan exists; else none was found. `undecided`: time ran out before that.
    """

    def __init__(self, constraint: str, message: str, *, proven: bool = False, undecided: bool = False) -> None:
        super().__init__(message)
        self.constraint = constraint
        self.proven = proven
        self.undecided = not proven and (undecided or constraint == TIME_LIMIT)
        self.relaxed: dict[str, str | float | None] | None = None  # what would help: constraint, amount, unit, place
        self.blamed: tuple[int, int] | None = None  # the move (contact to contact) without which there may be a plan

    def blaming(self, move: tuple[int, int] | None) -> Self:
        """The same, with the move that another attempt should do without; None where no other would help."""
        self.blamed = move
        return self

    @property
    def verdict(self) -> str:
        """In words, for people."""
        if self.proven:
            return f"proven infeasible {FOR_ALL_REACH}"
        return "undecided" if self.undecided else "infeasible"

    def out_of_time(self) -> InfeasibleError:
        """The same where time ran out before all was tried; what was not tried is no reason then."""
        if self.proven or self.undecided:
            return self
        more = "time ran out before all was tried, allow more with --time-limit"
        text = f"{self}; {more}" if self.relaxed else f"{more}; what was tried failed: {self}"
        undecided = InfeasibleError(self.constraint if self.relaxed else TIME_LIMIT, text, undecided=True)
        undecided.relaxed = self.relaxed
        return undecided

    def to_json(self) -> dict[str, object]:
        """What `crux plan --json` prints of it, beside the text."""
        scope = FOR_ALL_REACH if self.proven else None
        said = {"constraint": self.constraint, "proven": self.proven, "scope": scope, "undecided": self.undecided}
        return {**said, "relaxed": self.relaxed}

    def __reduce__(self) -> tuple[Any, ...]:
        """For the way from a worker process to its parent."""
        return partial(Exception.__new__, type(self)), (str(self),), self.__dict__


class HorizonError(InfeasibleError):
    """The horizon has too few steps; at least `needed` are needed, as far as is known. `tried`: so many give a plan."""

    def __init__(self, text: str, needed: int, *, tried: bool = False) -> None:
        super().__init__("horizon", f"horizon.steps: {text}")
        self.needed = needed
        if tried:
            self.relaxed = {"constraint": "horizon", "amount": needed, "unit": "steps", "place": None}


def unsolved(gait: str, status: str) -> InfeasibleError:
    """Why the exact problem of a gait was left without a solution; `status` is the solver's."""
    if "Time" in status:
        text = f"no time was left for the exact problem of the gait {gait}; allow more with --time-limit"
        return InfeasibleError(TIME_LIMIT, text)
    return InfeasibleError("dynamics", f"no solution of the exact problem was found for the gait {gait} ({status})")


class LevelGoalError(InfeasibleError):
    """A level body at the very goal has no hold in reach: said of that pose, not of all that the tolerances allow."""

    others = "; another body may hold there, but no way to it was found"


class StuckError(LevelGoalError):
    """A body at the goal has holds in reach, but nothing that was looked at leads there."""

    others = ""


def wrong(scenario: Scenario, key: str, value: str, expected: str) -> ScenarioError:
    """The error for a scenario whose author must correct `key`."""
    from crux_contracts.scenario import ScenarioError
    from crux_contracts.yaml_document import Problem

    return ScenarioError(scenario.path, [Problem(key, value, expected)])


def no_footholds(scenario: Scenario, what: str) -> None:
    """Raises ScenarioError where limbs may stand, which `what` ("routes are") does not support."""
    if scenario.footholds:
        raise wrong(scenario, "footholds", scenario.footholds[0].name, f"expected none: {what} not supported")
