"""Attempt, see what fails, change something, attempt again: the one loop, with a table of remedies."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from crux_planner.errors import InfeasibleError
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Session
from crux_planner.solvers import clock

State = TypeVar("State")
Way = TypeVar("Way")


def without_waits(
    session: Session,
    way: Way,
    shorter: Sequence[Way],
    finish: Callable[[Way], PlanResult | InfeasibleError],
) -> PlanResult | InfeasibleError:
    """What `finish` makes of the first of the `shorter` ways that works; of the way with its waits where none does or
    they are wanted.
    """
    found = None
    for moving in shorter if session.scenario.planner.idle != "keep" else ():
        found = finish(moving)
        if isinstance(found, PlanResult):
            return found
    if found is not None:
        session.work.log(f"refused without its waits: {found}")
    return finish(way)


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
