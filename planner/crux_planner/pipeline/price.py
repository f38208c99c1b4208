"""What it costs that a plan holds for all that the scenario does not know."""

from __future__ import annotations

from dataclasses import replace

from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.pipeline.session import Session
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.joint_rows import JointFunctions
from crux_planner.trajectory.solution import Solution


def nominal_cost(
    session: Session,
    problem: Problem,
    schedule: Schedule,
    solution: Solution,
    joints: JointFunctions | None = None,
) -> float | None:
    """J of the same contacts where nothing is uncertain, in the reach of the problem's boxes or, where there are
    `joints`, within their limits; None where nothing is uncertain in `problem`.
    """
    if (nominal := problem.nominal) is None:
        return None
    if problem.boxes is problem.limb_reach.inner:
        nominal = nominal.farther()
    nominal = replace(nominal, steps=problem.steps, goal=problem.goal)
    functions = None if joints is None else JointFunctions(nominal, joints.reaches, joints.limits)
    with session.work.part("price", 0.9):
        found = solve_within_torques(nominal, schedule, solution.start, session.deadline, functions)
    return found.cost if found.solved else None
