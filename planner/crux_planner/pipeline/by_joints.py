"""The exact P1 of a schedule with the joint limits themselves for (9a), and its check.

What the check refuses is learnt: the moment between two knots at which joints or links come too near to their limits or
to each other is one at which they keep off, with more margin where they did not; if that does not help, the body keeps
near its first path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import PlanReference
from crux_contracts.robot_bounds import JOINTS

from crux_planner.checker import CheckReport, Violation, check_plan
from crux_planner.model.arrays import Array
from crux_planner.model.hands import TILTED
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.pipeline.foreseen import beyond_limits
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.price import nominal_cost
from crux_planner.pipeline.refusals import eased, refused_by, slowed
from crux_planner.pipeline.session import Session
from crux_planner.search.pose_path import Ended
from crux_planner.trajectory.exact import TOO_WEAK, solve_within_torques
from crux_planner.trajectory.joint_limits import JointLimits, Moment
from crux_planner.trajectory.joint_rows import ELBOW, JointFunctions
from crux_planner.trajectory.link_planes import OFF_M
from crux_planner.trajectory.solution import Start
from crux_planner.trajectory.stage_functions import POSE

Clear = Callable[[Array, Array], Array | None]
"""For a body pose (6,) and hands (4, 4), the nearest pose at which links keep off each other."""

PLAN_RAD = 0.02  # margin to joint limits
ROUNDS = 6  # of the exact P1 and its check
UNLIMITED = JointLimits.about(np.zeros((0, BODY_STATES)), PLAN_RAD)  # of functions that have no schedule yet
_BETWEEN_RAD = 0.01  # margin at a moment at which a plan was refused: between those looked at, joints are no farther
_MORE_RAD, _MORE_M = 0.01, 0.0015  # beyond what the check misses at a moment looked at
_OUT_S = 1.0  # about a moment at which a limb is out of reach
_MOST_MORE_APART_M = 0.0075  # from where the path is kept to
_SAME_SHARE = 0.15  # of an interval, within which moments are one
_UNSURE = "_uncertain"  # what the check finds where holds are elsewhere
_UNREACHED = ("inverse_kinematics", "inverse_kinematics_orientation")
_APART = ("clearance_limbs",)
_OFF_SURFACES = ("clearance_body", "clearance_link")  # answered where there are bounded ones
_ANSWERED = ("joint_position", *_UNREACHED)
_STRETCHED_RAD = 0.02  # off a straight elbow where the check finds a gripper beyond reach
_ALONG_M = 0.02  # of the map's path, where limbs have no closed form
_NEAR_M = 0.02  # of the map's path, where links come too near to each other; a quarter of it the second time


def solve_by_joints(
    session: Session,
    problem: Problem,
    schedule: Schedule,
    first: Start,
    functions: JointFunctions,
    clear: Clear = lambda pose, _hands: pose,
) -> PlanResult | Ended | None:
    """A checked plan for a schedule; what the check refuses is answered, `ROUNDS` times at most. Or the knot at which
    motors are too weak for the contacts or the check still refuses it, None where the program has no solution. `clear`
    has the nearest pose to one at which links keep off each other.
    """
    work, start, refused = session.work, first, None
    begun = JointLimits.about(first.body, PLAN_RAD + problem.unsure_rad)
    if first.clear is not None:
        begun = functions.nearer(begun, schedule, first.clear, first.body)
    limits = begun
    for _ in range(ROUNDS):
        with work.part("nlp", 0.5):
            functions = functions.within(limits)
            solution = solve_within_torques(problem, schedule, start, session.deadline, functions)
        if solution.status == TOO_WEAK:
            return Ended(max(solution.torque_shares.items(), key=lambda each: each[1])[0][0], by_places=True)
        if not solution.solved:
            if (along := _along_path(problem, limits)) is None:
                return refused
            limits, start = along, first
            continue
        with work.part("message", 0.8):
            message = plan_message(session.scenario, session.robot, problem, schedule, solution, session.method)
        plan = PlanReference(message)
        with work.part("check", 0.8):
            report = CheckReport(beyond_limits(plan, functions.reaches))
            report = check_plan(message, session.robot) if report.ok else report
        if report.ok:
            result = PlanResult.of(message, report, solution, schedule.gait, work)
            loose = functions.within(JointLimits.about(solution.body, PLAN_RAD))
            result.nominal_cost = nominal_cost(session, problem, schedule, solution, loose)
            return result
        refused = _worst(report, problem.dt_s)
        work.log(f"{refused_by(report)}; once more with less of those joints or of their reach")
        seen = partial(_moment, plan, problem, solution.body)
        apart = (*_APART, *_OFF_SURFACES) if len(problem.solids.yaw_rad) else _APART
        answer, others = _answered(limits, report, seen, clear, apart)
        if any(each.constraint in apart for each in report.violations):
            answer = functions.nearer(answer, schedule, begun.path, solution.body)
        again = (answer.near_m != limits.near_m).any()
        easier = _easier(problem, replace(report, violations=others), schedule, solution.body) if others else None
        if others and easier is None:
            if (along := _along_path(problem, limits)) is None:
                return refused
            limits, start = along, first
            continue
        limits, problem = answer, easier or problem
        torques_Nm = np.minimum(problem.torque_limits_Nm, solution.torque_limits_Nm)
        problem, start = replace(problem, torque_limits_Nm=torques_Nm), first if again else solution.start
    return refused


def _along_path(problem: Problem, limits: JointLimits) -> JointLimits | None:
    """The limits with the body near its first path all along, where limbs have no closed form: angles mean something
    where a limb's branch reaches, and only there does the program find its way. None where the body is near already.
    """
    if problem.closed_form or (limits.near_m <= _ALONG_M).all():
        return None
    return replace(limits, near_m=np.minimum(limits.near_m, _ALONG_M))


def _worst(report: CheckReport, dt_s: float) -> Ended | None:
    """Where the check found the worst violation that has a time."""
    timed = [(each.amount, each.time_s, each.joint) for each in report.violations if each.time_s is not None]
    if not timed:
        return None
    _, time_s, joint = max(timed, key=lambda each: each[0])
    return Ended(int(time_s / dt_s), by_places=joint is not None and joint <= ELBOW)


def _moment(plan: PlanReference, problem: Problem, body: Array, time_s: float) -> tuple[Moment, Array]:
    """What a plan has at a time, with body states (N + 1, 12) at its knots; and the body's pose (6,)."""
    interval, share = plan.at(time_s)
    to_w, heading = rotation_z(problem.heading_rad), np.array([0.0, 0.0, problem.heading_rad])
    place, rpy = plan.body(time_s)
    straight = body[interval, :POSE] + share * (body[interval + 1, :POSE] - body[interval, :POSE])
    limbs = [plan.limb(limb, interval, share) for limb in range(len(LIMB_NAMES))]
    tilted = problem.hand_numbers == TILTED
    hands = np.array(
        [
            [*(at.position_w_m @ to_w), at.yaw_w_rad - problem.heading_rad, *(at.tilt_w_rad @ to_w[:2, :2] * tilted)]
            for at in limbs
        ]
    )[:, : problem.hand_numbers]
    pose = np.concatenate([place @ to_w, rpy - heading])
    margin_rad = np.full((len(limbs), problem.chain_slots or JOINTS), _BETWEEN_RAD + problem.unsure_rad)
    return Moment(interval, share, hands, margin_rad, OFF_M + problem.unsure_m, pose - straight), pose


def _answered(
    limits: JointLimits,
    report: CheckReport,
    seen: Callable[[float], tuple[Moment, Array]],
    clear: Clear,
    apart: tuple[str, ...] = _APART,
) -> tuple[JointLimits, list[Violation]]:
    """Limits under which joints and links may pass, and the violations that limits do not answer; `seen` is what there
    is at a time, and the body's pose; those of constraints `apart` are answered by planes between what is too near to
    each other, or by keeping the body near its path.
    """
    others, moments, near_m = list[Violation](), list(limits.moments), limits.near_m.copy()
    unreached = [each.time_s for each in report.violations if each.constraint in _UNREACHED and each.time_s is not None]
    for each in report.violations:
        constraint = each.constraint.removesuffix(_UNSURE)
        beside = each.time_s is not None and any(abs(each.time_s - time_s) <= _OUT_S for time_s in unreached)
        if beside and constraint not in (*_ANSWERED, *_APART):
            continue  # of a posture that is none: to be seen where the limb reaches
        if each.time_s is None or constraint not in (*_ANSWERED, *apart):
            others.append(each)
            continue
        here, pose = seen(each.time_s)
        if each.constraint in apart:
            here = replace(here, clear=clear(pose, here.hands))
            if here.clear is None and each.constraint in _APART:
                others.append(each)
                continue
        number = next((i for i, known in enumerate(moments) if known.near(here, _SAME_SHARE)), len(moments))
        known = moments[number] if number < len(limits.moments) else None
        if known is None or known.off is None:  # or found a moment ago
            moments[number : number + 1] = [here]
            continue
        far = each.constraint in apart and known.apart_m >= here.apart_m + _MOST_MORE_APART_M
        if far and not _kept_nearer(near_m, limits.near_m, here.interval):
            others.append(each)
        moments[number] = _farther(known, here, each)
    return replace(limits, moments=tuple(moments), near_m=near_m), others


def _kept_nearer(near_m: Array, before_m: Array, interval: int) -> bool:
    """Whether the body can be kept nearer to its first path about an interval than it was; then it is, in `near_m`."""
    about = slice(max(0, interval - 2), interval + 4)
    if (before_m[about] < _NEAR_M).all():
        return False
    nearer = np.where(np.isfinite(before_m[about]), _NEAR_M / 4, _NEAR_M)
    near_m[about] = np.minimum(near_m[about], nearer)
    return True


def _farther(known: Moment, here: Moment, violation: Violation) -> Moment:
    """A moment that was looked at, as it is now, with more margin for what is violated."""
    margin_rad, apart_m = known.margin_rad.copy(), known.apart_m
    if violation.constraint in (*_APART, *_OFF_SURFACES):
        apart_m += violation.amount + _MORE_M
    else:
        joint, lacking_rad = violation.joint, violation.amount
        if joint is None:
            joint, lacking_rad = ELBOW, _STRETCHED_RAD
        margin_rad[LIMB_NAMES.index(violation.limb or ""), joint] += lacking_rad + _MORE_RAD
    return replace(here, margin_rad=margin_rad, apart_m=apart_m)


def _easier(problem: Problem, report: CheckReport, schedule: Schedule, body: Array) -> Problem | None:
    """The problem with less of the joints, or a slower body, where the check asks for it."""
    if (easier := eased(problem, report)) is not None:
        return easier
    speed = np.abs(body[:, 6:9]).max(axis=1)
    slow = slowed(problem.speed_limits, report, schedule.contacts, speed, problem.dt_s)
    return None if slow in (None, dict(problem.speed_limits)) else replace(problem, speed_limits=slow or {})
