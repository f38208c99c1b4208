"""A solution of which few knots are in the way of a changed problem: solved again about these knots alone.

A torque that is too high for a moment, or a joint that is to give less there, leaves the rest of a long route as it is;
solved over all of it, every step would be as short as the worst of these places asks for.
"""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.trajectory.interior_point import Outcome, first_point, minimise
from crux_planner.trajectory.stage_problem import StageProblem

_MARGIN = 12  # knots before and after those with rows that are violated, where the rest of the plan gives way to them
_LONGEST = 96  # knots of a window, unless more in a row are violated; plans of no more are solved at once
_VIOLATED, _OFF = 1e-5, 1e-6  # by a row, and what (8) may lack in a solution


Window = tuple[slice, slice]
"""Its knots, and those of them that rows are violated at which it is about."""


def windows(stages: StageProblem, body: Array, columns: Array) -> list[Window] | None:
    """Windows, which may overlap, with all rows that a solution of (8) violates; None where it is no solution, or a
    short one.
    """
    defects = np.abs(stages.next_states(body, columns) - body[1:]).max()
    if stages.knots <= _LONGEST or max(defects, np.abs(stages.pinned * (body[-1] - stages.last)).max()) > _OFF:
        return None
    groups: list[slice] = []
    for k in np.flatnonzero(stages.lacking(body, columns) > _VIOLATED).tolist():
        joined = groups and (k == groups[-1].stop or k + 1 - groups[-1].start <= _LONGEST - 2 * _MARGIN)
        if joined and k - groups[-1].stop < 2 * _MARGIN:
            groups[-1] = slice(groups[-1].start, k + 1)
        else:
            groups.append(slice(k, k + 1))
    return [(slice(max(g.start - _MARGIN, 0), min(g.stop + _MARGIN, stages.knots)), g) for g in groups]


def minimise_within(
    stages: StageProblem, parts: list[Window], body: Array, columns: Array, deadline: float
) -> tuple[Array, Array, int] | None:
    """Body and columns with these windows solved one after the other, and the iterations in all; None where one does
    not converge.
    """
    body, columns, iterations = body.copy(), columns.copy(), 0
    for knots, about in parts:
        first, last = knots.start, knots.stop
        begin = body[first : last + 1], columns[first:last]
        window = stages.window(first, last, body)
        window = window.without_violated(slice(about.start - first, about.stop - first), *begin)
        outcome: Outcome = minimise(window, first_point(window, *begin), deadline)
        if not outcome.solved:
            return None
        found = outcome.point
        body[first + 1 : last], columns[first:last] = (
            found.body[1:-1],
            np.where(window.fixed, columns[first:last], found.columns),
        )
        if last == stages.knots:
            body[last] = found.body[-1]
        iterations += outcome.iterations
    return body, columns, iterations
