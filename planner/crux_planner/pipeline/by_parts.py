"""A far climb as one plan of the parts of a route, at rest between them: where no way to its goal is found at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from crux_contracts.plan_file import plan_id

from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.build import start_inertia
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.problem import Pose, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.pipeline.grip_loads import bear_more
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.refusals import refused_by
from crux_planner.pipeline.remaining_plan import RemainingPlan, read_remaining
from crux_planner.pipeline.restart import with_objective
from crux_planner.pipeline.route import TOLERANCE_DEG, is_long, plan_route
from crux_planner.pipeline.solve_and_check import Climb
from crux_planner.trajectory.solution import Solution

WAY_S = 10.0  # of CPU for each way that a part is tried by


def plan_by_parts(climb: Climb) -> PlanResult | None:
    """A checked plan; None where a part is not found in time, has a grasp that the climb has not, or together they take
    more steps than it may; and where the way is short or the body follows surfaces.
    """
    session, work = climb.session, climb.work
    if climb.problem.follows:
        return None
    with work.part("parts", 0.3):
        parts = _parts(climb)
    read = None if parts is None else _read(climb.problem, parts)
    if parts is None or read is None or sum(each.steps for each in read) > climb.problem.steps:
        return None
    solution, schedule = _joined(climb.problem, parts, read)
    with work.part("check", 0.8):
        message = plan_message(session.scenario, session.robot, climb.problem, schedule, solution, session.method)
        bear_more(message, _lacking(climb, read), climb.problem)
        report = check_plan(message, session.robot)
    if not report.ok:
        work.log(f"the parts of a route together: {refused_by(report)}")
        return None
    assert report.cost is not None  # of climbs
    message.cost = report.cost
    message.plan_id = plan_id(message)
    return PlanResult.of(message, report, replace(solution, cost=report.cost), schedule.gait, work)


def _parts(climb: Climb) -> list[PlanResult] | None:
    session, robot = climb.session, climb.session.robot
    if not is_long(session.scenario):
        return None
    turn = abs(float(climb.problem.goal.body.rpy_rad[2])) + np.radians(TOLERANCE_DEG)
    speed = robot.body.max_speed_m_s / (np.cos(turn) + np.sin(turn) if turn < np.pi / 4 else np.sqrt(2.0))
    slower = replace(robot, body=replace(robot.body, max_speed_m_s=speed))  # along the axes of any part's first pose
    even = with_objective(session.scenario, "paper")  # the steps of all parts; the whole gets its pace later
    try:
        return list(plan_route(even, slower, time_limit_s=WAY_S, deadline=session.deadline))
    except InfeasibleError:
        return None


def _read(problem: Problem, parts: Sequence[PlanResult]) -> list[RemainingPlan] | None:
    """The parts in the numbers of one problem; None where one has a grasp that is none of its contacts."""
    read, stance = list[RemainingPlan](), problem.start_contacts
    for part in parts:
        found = read_remaining(replace(problem, start_contacts=stance), part.plan, 0)
        if found is None:
            return None
        read.append(found)
        one, two, three, four = (contact for contact in found.schedule.contacts[-1] if contact is not None)
        stance = one, two, three, four
    return read


def _joined(problem: Problem, parts: Sequence[PlanResult], read: Sequence[RemainingPlan]) -> tuple[Solution, Schedule]:
    """One after the other."""
    schedules, starts = [each.schedule for each in read], [each.start for each in read]
    schedule = Schedule(
        [move for each in schedules for move in each.moves],
        [knot for each in schedules[:-1] for knot in each.contacts[:-1]] + schedules[-1].contacts,
        np.concatenate([*(each.poses[:-1] for each in schedules[:-1]), schedules[-1].poses]),
    )
    solution = Solution(
        body=np.concatenate([*(each.body[:-1] for each in starts[:-1]), starts[-1].body]),
        wrenches=[knot for each in starts for knot in each.wrenches],
        cost=0.0,
        iterations=sum(part.iterations for part in parts),
        status="solved",
        solved=True,
        position_residual_m=max(part.position_residual_m for part in parts),
        force_residual_N=max(part.force_residual_N for part in parts),
        torque_shares={},
        torque_limits_Nm=problem.torque_limits_Nm,
    )
    return solution, schedule


def _lacking(climb: Climb, read: Sequence[RemainingPlan]) -> Array:
    """(N, 6) what the parts' wrenches lack in W: each part has the inertia of its own first posture, and (8) has that
    of the climb's.
    """
    problem, lack = climb.problem, list[Array]()
    for each in read:
        body = each.start.body
        grasps = [problem.contacts[c] for c in each.schedule.contacts[0] if c is not None]
        begun = start_inertia(climb.session.robot, Pose(body[0, :3], body[0, 3:6]), grasps)
        more, rate = problem.inertia_b - begun, body[:, 9:12]
        spun = np.diff(rate, axis=0) / problem.dt_s @ more.T + np.cross(rate[:-1], rate[:-1] @ more.T)
        twist = np.einsum("kij,kj->ki", rotation_from_rpy(body[:-1, 3:6]), spun) @ rotation_z(problem.heading_rad).T
        lack.append(np.hstack([np.zeros_like(twist), twist]))
    return np.concatenate(lack)
