"""The exact P1 of a schedule with the joint limits themselves for (9a), and its check.

What the check refuses is learnt: joints that come too near to their limits between two knots get more margin, and limbs
that come too near to each other more clearance; if that does not help, the body keeps near its first path.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.checker import CheckReport, Violation, check_plan
from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.refusals import eased, refused_by, slowed
from crux_planner.pipeline.session import Session
from crux_planner.search.pose_path import Ended
from crux_planner.trajectory.exact import TOO_WEAK, solve_within_torques
from crux_planner.trajectory.joint_rows import ELBOW, JointFunctions, JointLimits
from crux_planner.trajectory.solution import Start

PLAN_RAD = 0.02  # margin to joint limits
ROUNDS = 6  # of the exact P1 and its check
UNLIMITED = JointLimits.about(np.zeros((0, BODY_STATES)), PLAN_RAD)  # of functions that have no schedule yet
_MORE_RAD = 0.01  # beyond what the check misses
_MORE_M, _MOST_MORE_M = 0.0015, 0.003  # of links: beyond what the check misses; where that is more, planes are wrong
_MOST_APART_M = 0.012  # from where the path is kept to
_ANSWERED = ("joint_position", "inverse_kinematics", "clearance_limbs")
_STRETCHED_RAD = 0.05  # off a straight elbow where the check finds a gripper beyond reach
_NEAR_M = 0.02  # of the map's path, where links come too near to each other; a quarter of it the second time


def solve_by_joints(
    session: Session, problem: Problem, schedule: Schedule, first: Start, functions: JointFunctions
) -> PlanResult | Ended | None:
    """A checked plan for a schedule; what the check refuses is answered, `ROUNDS` times at most. Or the knot at which
    motors are too weak for the contacts or the check still refuses it, None where the program has no solution.
    """
    work, start, refused = session.work, first, None
    limits = JointLimits.about(first.body, PLAN_RAD)
    for _ in range(ROUNDS):
        with work.part("nlp", 0.5):
            functions = functions.within(limits)
            solution = solve_within_torques(problem, schedule, start, session.deadline, functions)
        if solution.status == TOO_WEAK:
            return Ended(max(solution.torque_shares.items(), key=lambda each: each[1])[0][0], by_places=True)
        if not solution.solved:
            return refused
        with work.part("message", 0.8):
            message = plan_message(session.scenario, session.robot, problem, schedule, solution, session.method)
        with work.part("check", 0.8):
            report = check_plan(message, session.robot)
        if report.ok:
            return PlanResult.of(message, report, solution, schedule.gait, work)
        refused = _worst(report, problem.dt_s)
        work.log(f"{refused_by(report)}; once more with less of those joints or of their reach")
        answer, others = _answered(limits, report, problem.dt_s)
        if any(each.constraint == "clearance_limbs" for each in report.violations):
            answer = functions.nearer(answer, schedule, first.body, solution.body)
        again = (answer.near_m != limits.near_m).any()
        easier = _easier(problem, replace(report, violations=others), schedule, solution.body) if others else None
        if others and easier is None:
            return refused
        limits, problem = answer, easier or problem
        torques_Nm = np.minimum(problem.torque_limits_Nm, solution.torque_limits_Nm)
        problem, start = replace(problem, torque_limits_Nm=torques_Nm), first if again else solution.start
    return refused


def _worst(report: CheckReport, dt_s: float) -> Ended | None:
    """Where the check found the worst violation that has a time."""
    timed = [(each.amount, each.time_s, each.joint) for each in report.violations if each.time_s is not None]
    if not timed:
        return None
    _, time_s, joint = max(timed, key=lambda each: each[0])
    return Ended(int(time_s / dt_s), by_places=joint is not None and joint <= ELBOW)


def _answered(limits: JointLimits, report: CheckReport, dt_s: float) -> tuple[JointLimits, list[Violation]]:
    """Limits under which joints and links may pass, and the violations that limits do not answer."""
    others, margin_rad, apart_m, near_m = [], limits.margin_rad.copy(), limits.apart_m.copy(), limits.near_m.copy()
    for each in report.violations:
        if each.time_s is None or each.constraint not in _ANSWERED:
            others.append(each)
            continue
        k = int(each.time_s / dt_s)
        if each.constraint == "clearance_limbs":
            about, at = slice(max(0, k - 2), k + 4), slice(k, k + 2)
            if (limits.apart_m[at] < _MOST_APART_M).all():
                apart_m[at] = np.maximum(apart_m[at], limits.apart_m[at] + min(each.amount, _MOST_MORE_M) + _MORE_M)
                continue
            if (limits.near_m[about] < _NEAR_M).all():
                others.append(each)
            near_m[about] = np.minimum(near_m[about], np.where(np.isfinite(limits.near_m[about]), _NEAR_M / 4, _NEAR_M))
            continue
        joint, lacking_rad = (each.joint, each.amount) if each.joint is not None else (ELBOW, _STRETCHED_RAD)
        margin_rad[k : k + 2, LIMB_NAMES.index(each.limb or ""), joint] += lacking_rad + _MORE_RAD
    return replace(limits, margin_rad=margin_rad, apart_m=apart_m, near_m=near_m), others


def _easier(problem: Problem, report: CheckReport, schedule: Schedule, body: Array) -> Problem | None:
    """The problem with less of the joints, or a slower body, where the check asks for it."""
    if (easier := eased(problem, report)) is not None:
        return easier
    speed = np.abs(body[:, 6:9]).max(axis=1)
    slow = slowed(problem.speed_limits, report, schedule.contacts, speed, problem.dt_s)
    return None if slow in (None, dict(problem.speed_limits)) else replace(problem, speed_limits=slow or {})
