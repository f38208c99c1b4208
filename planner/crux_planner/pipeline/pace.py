"""The pace of a climb (planner.objective): after the exact program, each interval takes the least time that the robot's
pace allows. Contacts, poses and the order of events stay as they are.

Fingers open no wider in a swing than holds and clearance need, and move while the gripper lifts and comes down, but not
where the checker refuses it. Speeds follow from the times. The contact wrenches change by the least that balances the
body's new accelerations, and fingers squeeze as much harder as friction then needs. The checker has the last word:
where it refuses the plan, the intervals around take longer.
"""

from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES, N_LIMBS
from crux_contracts.interpolation import LOAD_SPAN, UNLOAD_SPAN, SwingShares, swing_shares
from crux_contracts.plan_file import plan_id
from crux_contracts.plan_series import PlanSeries, plan_series
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario
from crux_msgs import plan_t

from crux_planner.checker import CheckReport, check_plan
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem
from crux_planner.pipeline.grip_loads import bear_more
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Work

STRETCH = {"time": 1.0, "balanced": 1.25}  # of the least times, by objective
LONGER = 1.2  # times longer, where the checker refuses an interval and beside it
ROUNDS = 12  # of that
OF_THE_WAY = ("joint_position", "inverse_kinematics", "clearance")  # begin names of constraints that no time changes
PEAK, PEAK_ACCELERATION = 1.5, 6.0  # of a smooth step over its way and time, and over its way and time squared
BODY_SHARE = 0.999  # of the body's limits: the check is exact


def paced(result: PlanResult, scenario: Scenario, robot: Robot, work: Work) -> PlanResult:
    """The plan at the pace that the scenario asks for: as it is for `paper`, and where no pace passes the check."""
    if scenario.planner.objective == "paper":
        return result
    with work.part("pace", 0.95):
        ways = [_at_pace(way, scenario, robot) for way in (result, result.in_pairs) if way is not None]
        quick = min(filter(None, ways), key=lambda each: each.plan.knots[-1].time_s, default=None)
    if quick is None:
        work.log(
            f"at no pace that planner.objective {scenario.planner.objective} asks for does the plan pass the check"
        )
    return quick or result


def _at_pace(result: PlanResult, scenario: Scenario, robot: Robot) -> PlanResult | None:
    """Fingers that move while the gripper does come first, where no limb stands."""
    of_grips = [plan_t.FORMAT_MOVING_FINGERS, plan_t.FORMAT_OWN_TIMES]
    formats = [plan_t.FORMAT_FEET] if result.plan.format == plan_t.FORMAT_FEET else of_grips
    return next(filter(None, (_paced(result, scenario, robot, plan_format) for plan_format in formats)), None)


def _paced(result: PlanResult, scenario: Scenario, robot: Robot, plan_format: int) -> PlanResult | None:
    problem = build_problem(scenario, robot)
    plan = plan_t.decode(result.plan.encode())
    _narrow_fingers(plan, robot.pace.opening_clearance_m)
    plan.format, squeeze_N = plan_format, np.zeros((len(plan.knots) - 1, N_LIMBS))
    least_s = STRETCH[scenario.planner.objective] * least_times_s(plan_series(plan), robot, swing_shares(plan_format))
    for _ in range(ROUNDS):
        quick = plan_t.decode(plan.encode())
        set_times(quick, least_s, problem, squeeze_N)
        report = check_plan(quick, robot)
        if report.ok:
            assert report.cost is not None  # of climbs
            quick.cost = report.cost
            quick.plan_id = plan_id(quick)
            return replace(result, plan=quick, check=report, cost=report.cost, gap=None, nominal_cost=None)
        at = _intervals(quick, report)
        longer = _lengthen(least_s, report, at)
        if not _squeeze(squeeze_N, report, at, plan_series(quick).friction) and not longer:
            break
    return None


def least_times_s(series: PlanSeries, robot: Robot, shares: SwingShares) -> Array:
    """(N,) the least time of each interval by the robot's pace: of the body's way, of what each limb does, and of the
    load that limbs give off and take up.
    """
    pace, speed = robot.pace, robot.gripper.max_finger_speed_m_s
    body_m, turn_rad = (np.abs(np.diff(v, axis=0)) for v in (series.body_position_m, series.body_rpy_rad))
    times = [body_m.max(axis=1) / (BODY_SHARE * pace.body_speed_m_s), turn_rad.max(axis=1) / pace.body_rate_rad_s]
    way_m = np.linalg.norm(np.diff(series.gripper_position_m, axis=0), axis=2)
    twist_rad = np.abs(np.diff(series.gripper_yaw_rad, axis=0))
    twist_rad += np.linalg.norm(np.diff(series.gripper_tilt_rad, axis=0), axis=2)
    opens_m = np.abs(np.diff(series.separation_m, axis=0)) / 2
    steady_s = np.maximum(way_m / pace.swing_speed_m_s, twist_rad / pace.yaw_rate_rad_s)
    smooth_s = np.maximum(PEAK * steady_s, np.sqrt(PEAK_ACCELERATION * way_m / pace.swing_acceleration_m_s2))
    air = ~series.stance
    before, after = np.vstack([np.zeros((1, N_LIMBS), bool), air[:-2]]), air[1:]
    here = air[:-1]
    leaves, comes = here & ~before, here & ~after
    fingers_s = opens_m / speed
    times += [np.where(here, steady_s, 0.0).max(axis=1)]
    times += [np.where(here & (after | shares.fingers_move), fingers_s, 0.0).max(axis=1)]
    times += [np.where(leaves, smooth_s / (1 - shares.lift), 0.0).max(axis=1)]
    times += [np.where(leaves & (not shares.fingers_move), fingers_s / shares.lift, 0.0).max(axis=1)]
    times += [np.where(comes, smooth_s / shares.arrive, 0.0).max(axis=1)]
    times += [np.where(~here & after, pace.load_time_s / UNLOAD_SPAN, 0.0).max(axis=1)]
    times += [np.where(~here & before, pace.load_time_s / LOAD_SPAN, 0.0).max(axis=1)]
    least_s: Array = np.maximum(np.max(times, axis=0), pace.min_step_s)
    return least_s


def set_times(plan: plan_t, step_s: Array, problem: Problem, squeeze_N: Array) -> None:
    """The plan with these times of its intervals (N,), in place: velocities, and wrenches that balance the body, while
    fingers squeeze by (N, 4) harder.
    """
    series = plan_series(plan)
    slower = np.diff(series.time_s) / step_s
    slower = np.append(slower, slower[-1])
    velocity, rate = (slower[:, None] * v for v in (series.body_velocity_m_s, series.body_angular_velocity_b_rad_s))
    old_s = np.diff(series.time_s)[:, None]
    push = np.diff(velocity, axis=0) / step_s[:, None] - np.diff(series.body_velocity_m_s, axis=0) / old_s
    spun = [
        np.diff(w, axis=0) / s @ problem.inertia_b.T + np.cross(w[:-1], w[:-1] @ problem.inertia_b.T)
        for w, s in ((rate, step_s[:, None]), (series.body_angular_velocity_b_rad_s, old_s))
    ]
    turned = rotation_from_rpy(series.body_rpy_rad[:-1])
    twist = np.einsum("kij,kj->ki", turned, spun[0] - spun[1])
    bear_more(plan, np.hstack([problem.mass_kg * push, twist]), problem, squeeze_N)
    times = np.concatenate([[0.0], np.cumsum(step_s)])
    for k, knot in enumerate(plan.knots):
        knot.time_s = float(times[k])
        knot.body_velocity_w_m_s = velocity[k].tolist()
        knot.body_angular_velocity_b_rad_s = rate[k].tolist()
    plan.plan_id = plan_id(plan)


def _narrow_fingers(plan: plan_t, clearance_m: float) -> None:
    """Opens fingers in a swing between holds no wider than the hold that is near and the clearance need, in place."""
    series = plan_series(plan)
    for swing in series.swings():
        if series.on_wall[[max(swing.first - 1, 0), swing.last + 1], swing.limb].any():
            continue
        knots = range(swing.first + 1, swing.last + 1)
        ends_m = series.separation_m[[max(swing.first - 1, 0), swing.last + 1], swing.limb]
        widths_m = np.linspace(ends_m[0], ends_m[1], len(knots)) if len(knots) > 1 else [ends_m.max()]
        for k, width_m in zip(knots, widths_m, strict=True):
            limb = plan.knots[k].limbs[swing.limb]
            limb.finger_separation_m = min(limb.finger_separation_m, width_m + 2 * clearance_m)


def _intervals(plan: plan_t, report: CheckReport) -> list[list[int]]:
    """About each violation the intervals of a plan; none where it has no time."""
    times, last = [knot.time_s for knot in plan.knots], len(plan.knots) - 2
    found = list[list[int]]()
    for violation in report.violations:
        at = 0 if violation.time_s is None else int(np.searchsorted(times, violation.time_s + 1e-9)) - 1
        near = range(max(at - 1, 0), min(at + 1, last) + 1)
        found.append([] if violation.time_s is None else list(near))
    return found


def _lengthen(step_s: Array, report: CheckReport, at: list[list[int]]) -> bool:
    """Lengthens the intervals `at` what the checker found, in place; False where that leaves them as they are.

    Where the body passes between two knots depends on how the intervals beside compare: what is about its way alone
    is answered by intervals of one length, between which it passes as it does with even steps.
    """
    before, slower, evened = step_s.copy(), set[int](), list[list[int]]()
    for violation, near in zip(report.violations, at, strict=True):
        if violation.constraint.startswith(OF_THE_WAY):
            evened.append(near)
        else:
            slower |= {*near}
    step_s[sorted(slower)] *= LONGER
    for near in evened:
        step_s[near] = step_s[near].max(initial=0.0)
    return bool((step_s != before).any())


def _squeeze(squeeze_N: Array, report: CheckReport, at: list[list[int]], friction: Array) -> bool:
    """Makes fingers that the checker found beyond their limit surface `at` some intervals squeeze harder, in place,
    by what lacks there; `friction` (K, 4). Whether any do.
    """
    before = squeeze_N.copy()
    for violation, near in zip(report.violations, at, strict=True):
        if not violation.constraint.startswith("limit_surface") or violation.limb is None:
            continue
        limb = LIMB_NAMES.index(violation.limb)
        for k in near:
            if friction[k, limb] > 0.0:
                squeeze_N[k, limb] += violation.amount / friction[k, limb]
    return bool((squeeze_N != before).any())
