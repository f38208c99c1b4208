"""The exact P1 with contacts fixed: body motion and finger forces under (2)-(4), (7), (8), (9a).

Solved stage by stage. Joint torques become constraints where they are found too high, at both ends of an interval: most
climbs need few.
"""

from dataclasses import replace

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.cost import schedule_cost
from crux_planner.physics.dynamics import WRENCH_INPUTS
from crux_planner.solvers import clock
from crux_planner.trajectory.interior_point import first_point, minimise
from crux_planner.trajectory.solution import Place, Solution, Start
from crux_planner.trajectory.stage_functions import COLUMN, StageFunctions
from crux_planner.trajectory.stage_problem import StageProblem
from crux_planner.trajectory.windows import minimise_within, windows

_TORQUE_WATCH, _TORQUE_TOLERANCE = 0.8, 1e-3  # shares of a limit from which a place is watched, and violated
_TORQUE_ROUNDS = 5
TOO_WEAK = "joint torques"
"""Status of a solution beyond its torques, where none within them is found."""


def solve_within_torques(
    problem: Problem, schedule: Schedule, start: Start, deadline: float, functions: StageFunctions | None = None
) -> Solution:
    """Solve P1 for a schedule; `functions` are those of this problem, if they are there already."""
    functions = functions or StageFunctions(problem)
    limited: frozenset[Place] = frozenset()
    beyond: Solution | None = None
    stages = StageProblem(functions, problem, schedule)
    if start.near:
        limited = _watched(stages.torque_shares(start.body, columns_of(stages, start)))
    for _ in range(_TORQUE_ROUNDS + 1):
        found = _solve_once(stages.limiting(limited, problem), schedule, start, deadline)
        if found is None and limited and np.any(problem.torque_limits_Nm < problem.last_torques_Nm):
            problem = replace(problem, torque_limits_Nm=problem.last_torques_Nm)
            found = _solve_once(stages.limiting(limited, problem), schedule, start, deadline)
        if found is None:
            break
        if max(found.torque_shares.values()) <= 1.0 + _TORQUE_TOLERANCE:
            return found
        limited |= _watched(found.torque_shares)
        beyond, start = found, found.start
    if beyond is not None and clock.now() <= deadline:
        return replace(beyond, solved=False, status=TOO_WEAK)
    nowhere = (np.inf, np.inf, dict[Place, float](), problem.torque_limits_Nm)
    status = "Time is over" if clock.now() > deadline else "not converged"
    return Solution(start.body, start.wrenches, np.inf, 0, status, False, *nowhere)


def _watched(shares: dict[Place, float]) -> frozenset[Place]:
    return frozenset(place for place, share in shares.items() if share > _TORQUE_WATCH)


def _solve_once(stages: StageProblem, schedule: Schedule, start: Start, until: float) -> Solution | None:
    """The solution stage by stage, only about the knots that rows are violated at if it starts from a solution
    elsewhere; None where that does not converge.
    """
    functions, problem = stages.functions, stages.problem
    body, columns = start.body, np.where(stages.fixed, stages.fixed_value, columns_of(stages, start))
    parts = windows(stages, body, columns) if start.near else None
    within = None if parts is None else minimise_within(stages, parts, body, columns, until)
    if within is None and parts is not None and np.any(problem.torque_limits_Nm < problem.last_torques_Nm):
        return None  # what joints may give at last is likelier to help than all knots at once
    if within is not None:
        body, columns, iterations = within
    else:
        outcome = minimise(stages, first_point(stages, body, columns), until)
        if not outcome.solved:
            return None
        body, iterations = outcome.point.body, outcome.iterations
        columns = np.where(stages.fixed, stages.fixed_value, outcome.point.columns)
    defects = np.abs(stages.next_states(body, columns) - body[1:])
    wrenches: list[dict[int, Array]] = [
        {int(limb): columns[k, limb, :WRENCH_INPUTS] * functions.scale for limb in np.flatnonzero(stages.stance[k])}
        for k in range(stages.knots)
    ]
    return Solution(
        body=body,
        wrenches=wrenches,
        cost=stages.cost(body, columns) + schedule_cost(schedule, problem),
        iterations=iterations,
        status="solved",
        solved=True,
        position_residual_m=float(defects[:, :3].max()),
        force_residual_N=float(defects[:, 6:9].max()) * problem.mass_kg / problem.dt_s,
        torque_shares=stages.torque_shares(body, columns),
        torque_limits_Nm=problem.torque_limits_Nm,
        columns=columns,
    )


def columns_of(stages: StageProblem, start: Start) -> Array:
    """Scaled columns (N, 4, 8) of where the solver starts; the spines' shares are 0 where only wrenches are known."""
    if start.columns is not None:
        return start.columns
    columns = np.zeros((stages.knots, 4, COLUMN))
    for k, knot in enumerate(start.wrenches):
        for limb, wrench in knot.items():
            columns[k, limb, :WRENCH_INPUTS] = wrench / stages.functions.scale
    return columns
