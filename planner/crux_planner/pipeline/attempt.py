"""Attempt, see what fails, change something, attempt again: the one loop, with a table of remedies."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from crux_planner.errors import InfeasibleError
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Session
from crux_planner.solvers import clock

State = TypeVar("State")
Planned = TypeVar("Planned", bound=Session)


def without_waits(
    session: Planned, shorter: Planned | None, finish: Callable[[Planned, bool], PlanResult | InfeasibleError]
) -> PlanResult | InfeasibleError:
    """What `finish` makes of the session without its waits; with them (True) where that fails or they are wanted."""
    if shorter is not None and session.scenario.planner.idle != "keep":
        found = finish(shorter, False)
        if isinstance(found, PlanResult):
            return found
        session.work.log(f"refused without its waits: {found}")
    return finish(session, True)


def attempts(
    state: State,
    attempt: Callable[[State], PlanResult | InfeasibleError | None],
    remedies: Sequence[Callable[[State, InfeasibleError], State | None]],
    failures: list[InfeasibleError],
    *,
    most: int,
    until: float = np.inf,
) -> tuple[PlanResult | None, State]:
    """The first plan that `attempt` makes, and of what: after each failure with what the first remedy that helps gives.

    None where none is made: after `most` attempts, where nothing is left to attempt (None), no remedy helps (all None),
    or a failure comes later than `until` (of clock.now). What fails is appended to `failures`.
    """
    for _ in range(most):
        outcome = attempt(state)
        if outcome is None or isinstance(outcome, PlanResult):
            return outcome, state
        failures.append(outcome)
        if clock.now() > until:
            break
        changed = next((new for remedy in remedies if (new := remedy(state, outcome)) is not None), None)
        if changed is None:
            break
        state = changed
    return None, state
