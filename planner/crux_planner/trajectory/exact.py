"""The exact P1 with contacts fixed: body motion and finger forces under (2)-(4), (7), (8), (9a).

Solved stage by stage; where that does not converge, by ipopt. Joint torques become constraints where they are found
too high, at both ends of an interval: most climbs need few.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.cost import schedule_cost
from crux_planner.physics.dynamics import WRENCH_INPUTS
from crux_planner.solvers import clock
from crux_planner.trajectory import nlp
from crux_planner.trajectory.interior_point import first_point, minimise
from crux_planner.trajectory.solution import Place, Solution, Start
from crux_planner.trajectory.stage_functions import StageFunctions
from crux_planner.trajectory.stage_problem import StageProblem

_TORQUE_WATCH, _TORQUE_TOLERANCE = 0.8, 1e-3  # shares of a limit from which a place is watched, and violated
_TORQUE_ROUNDS = 5
LEAST_LEFT_S = 1.0  # of the time is left to ipopt at least


def solve_within_torques(
    problem: Problem,
    schedule: Schedule,
    start: Start,
    deadline: float,
    functions: StageFunctions | None = None,
) -> Solution:
    """Solve P1 for a schedule; `functions` are those of this problem, if they are there already."""
    functions = functions or StageFunctions(problem)
    limited: frozenset[Place] = frozenset()
    if start.near:
        stages = StageProblem(functions, problem, schedule, limited)
        limited = _watched(stages.torque_shares(start.body, _columns(stages, start)))
    for _ in range(_TORQUE_ROUNDS + 1):
        found = _solve_once(functions, problem, schedule, start, limited, deadline)
        if found is None and limited and np.any(problem.torque_limits_Nm < problem.last_torques_Nm):
            problem = replace(problem, torque_limits_Nm=problem.last_torques_Nm)
            found = _solve_once(functions, problem, schedule, start, limited, deadline)
        if found is None and start.near:  # other ways follow that promise more than ipopt
            nowhere = (np.inf, np.inf, dict[Place, float](), problem.torque_limits_Nm)
            return Solution(start.body, start.wrenches, np.inf, 0, "not converged", False, *nowhere)
        left = max(deadline - clock.now(), LEAST_LEFT_S)
        solution = found or solve_by_ipopt(functions, problem, schedule, start, limited, left)
        beyond = {place for place, share in solution.torque_shares.items() if share > 1.0 + _TORQUE_TOLERANCE}
        if not solution.solved or not beyond:
            break
        limited |= _watched(solution.torque_shares)
        start = replace(start, body=solution.body, wrenches=solution.wrenches)
    else:
        return replace(solution, solved=False, status="joint torques")
    return solution


def _watched(shares: dict[Place, float]) -> frozenset[Place]:
    return frozenset(place for place, share in shares.items() if share > _TORQUE_WATCH)


def _solve_once(
    functions: StageFunctions,
    problem: Problem,
    schedule: Schedule,
    start: Start,
    limited: frozenset[Place],
    deadline: float,
) -> Solution | None:
    """The solution stage by stage; None where that does not converge."""
    stages = StageProblem(functions, problem, schedule, limited)
    outcome = minimise(stages, first_point(stages, start.body, _columns(stages, start)), deadline)
    if not outcome.solved:
        return None
    point = outcome.point
    columns = np.where(stages.fixed, stages.fixed_value, point.columns)
    found = nlp.Optimum(point.body, columns, outcome.cost, outcome.iterations, "Solve_Succeeded", True)
    return _solution(stages, schedule, found)


def solve_by_ipopt(
    functions: StageFunctions,
    problem: Problem,
    schedule: Schedule,
    start: Start,
    limited: frozenset[Place],
    time_limit_s: float,
    most_iterations: int = nlp.ITERATIONS,
) -> Solution:
    """The same problem, with constraints on the joint torques at the places `limited`, solved by ipopt."""
    stages = StageProblem(functions, problem, schedule, limited)
    found = nlp.solve(stages, start.body, _columns(stages, start), time_limit_s, most_iterations)
    return _solution(stages, schedule, found)


def _columns(stages: StageProblem, start: Start) -> Array:
    columns = stages.empty_columns()
    for k, knot in enumerate(start.wrenches):
        for limb, wrench in knot.items():
            columns[k, limb, :WRENCH_INPUTS] = wrench / stages.functions.scale
    return columns


def _solution(stages: StageProblem, schedule: Schedule, found: nlp.Optimum) -> Solution:
    problem, scale = stages.problem, stages.functions.scale
    defects = np.abs(stages.next_states(found.body, found.columns) - found.body[1:])
    wrenches: list[dict[int, Array]] = [
        {int(limb): found.columns[k, limb, :WRENCH_INPUTS] * scale for limb in np.flatnonzero(stages.stance[k])}
        for k in range(stages.knots)
    ]
    return Solution(
        body=found.body,
        wrenches=wrenches,
        cost=found.cost + schedule_cost(schedule, problem),
        iterations=found.iterations,
        status=found.status,
        solved=found.solved,
        position_residual_m=float(defects[:, :3].max()),
        force_residual_N=float(defects[:, 6:9].max()) * problem.mass_kg / problem.dt_s,
        torque_shares=stages.torque_shares(found.body, found.columns),
        torque_limits_Nm=problem.torque_limits_Nm,
    )
