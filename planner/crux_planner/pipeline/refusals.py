"""What the check asks for where it refuses a plan: a slower body on some supports, less of some joints, on a walk a
smaller workspace.

Between two knots the wrenches of a climb lag behind a body that moves; the controller shares the load anew, and so may
ask joints for more than the plan does. On a walk, near the stretched limb, a foot that
keeps its speed needs joints without bounds: the planner knows no joints, and learns from the check's joint speeds which
corner of the limb's box (9a) to leave out.
"""

from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.checker import CheckReport
from crux_planner.checker.report import JointLoad
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Contacts, SpeedLimits
from crux_planner.model.walk_problem import Cut, WalkProblem
from crux_planner.physics.speed_limits import WANTED_N
from crux_planner.trajectory.solution import WalkSolution

BETWEEN_KNOTS = "limit_surface_between_knots"
_OF_ACTUATORS = ("actuator_torque", "actuator_torque_shared", "actuator_torque_uncertain")
_TORQUES = ("joint_torque", "joint_torque_shared", "joint_torque_uncertain", *_OF_ACTUATORS)
_UNCERTAIN = "limit_surface_uncertain"
_LEAST_NM = 1e-9
_MORE, _LEAST_EASED = 1.5, 0.02  # of what a joint lacks it is to give less; and at least of its torque
_MORE_RESERVE = 1.1  # of what the limit surface lacks
_LEAST_CUT = 0.8  # of the speed is left at most, so that every cut counts
_BEGUN, _BLENDED = 0.1, 0.45  # of an interval: its own motion counts from, that of the one before to
_STILL_M_S = 1e-4  # slower is no motion
CUTS = 3  # times in a row
_LEFT_OUT = 0.12  # of the way from the middle of the box to the place
_FAR = 0.85  # of the box, along an axis: nearer to the middle a limb is not stretched


class TooFast(InfeasibleError):
    """A plan that the check refuses for what happens between its knots; with `speed_limits` it may pass."""

    def __init__(self, refused: InfeasibleError, speed_limits: SpeedLimits) -> None:
        super().__init__(refused.constraint, str(refused))
        self.speed_limits = speed_limits


def refused_by(report: CheckReport) -> InfeasibleError:
    """What a check finds most."""
    first = max(report.violations, key=lambda v: v.amount)
    who = " ".join(part for part in (first.limb, f"finger {first.finger}" if first.finger else None) if part)
    when = "" if first.time_s is None else f" at {first.time_s:.1f} s"
    text = f"every plan found fails the check: {first.constraint}{' of ' + who if who else ''}{when} by "
    return InfeasibleError(first.constraint, f"{text}{first.amount:.3g} {first.unit} {first.detail}".rstrip())


def slowed(
    speed_limits: SpeedLimits, report: CheckReport, contacts: list[list[int | None]], speed_m_s: Array, dt_s: float
) -> dict[Contacts, float] | None:
    """`speed_limits` with the speeds that the report asks for; None where more than slowness is wanted.

    `contacts` and `speed_m_s` (N + 1,), the largest component of the body's velocity, are those of the plan's knots.
    """
    cut = dict(speed_limits)
    for violation in (each for each in report.violations if each.constraint not in (*_TORQUES, _UNCERTAIN)):
        if violation.constraint != BETWEEN_KNOTS or violation.time_s is None:
            return None
        k = min(int(violation.time_s / dt_s + 1e-9), len(speed_m_s) - 2)
        share = violation.time_s / dt_s - k
        at = [j for j in (k - 1, k) if j >= 0 and (share < _BLENDED if j < k else share > _BEGUN)]
        fastest = float(np.max(speed_m_s[at]))
        if fastest < _STILL_M_S:
            return None
        allowed = fastest * min(WANTED_N / violation.amount, _LEAST_CUT)
        for j in at:
            held = tuple(contacts[j])
            cut[held] = min(cut.get(held, np.inf), allowed)
    return cut


def nearer(problem: Problem, report: CheckReport, contacts: list[list[int | None]]) -> Problem | None:
    """The climb with limbs in their boxes on the supports on which the check refuses what they do beyond; None where
    they are, or where the headings that were chosen leave no boxes.
    """
    times = [violation.time_s for violation in report.violations]
    at = [time_s / problem.dt_s for time_s in times if time_s is not None]
    knots = {int(end) for k in at for end in (k + 1e-9, np.ceil(k - 1e-9))}
    near = problem.near | {tuple(contacts[k]) for k in knots}
    if problem.boxes is problem.limb_reach.box or None in times or near == problem.near:
        return None
    return replace(problem, near=near)


def eased(problem: Problem, report: CheckReport) -> Problem | None:
    """The climb with less of the joints that are asked for too much between the knots, as the controller shares the
    load or where it is uncertain, and with more in reserve of the limit surface for that; None where that is not all
    that is wrong, or a joint has nothing left to give.
    """
    limits, last = problem.torque_limits_Nm.copy(), problem.last_torques_Nm.copy()
    reserve_N = problem.surface_reserve_N
    for violation in report.violations:
        if violation.constraint == _UNCERTAIN:
            reserve_N = max(reserve_N, problem.surface_reserve_N + _MORE_RESERVE * violation.amount)
            continue
        if violation.constraint not in _TORQUES or violation.limb is None or violation.joint is None:
            return None
        limb, joint = LIMB_NAMES.index(violation.limb), violation.joint
        peak, amount = _peaks(report.joints, violation.limb)[joint], violation.amount
        if violation.constraint in _OF_ACTUATORS:
            amount *= peak / max(_peaks(report.actuators, violation.limb)[joint], _LEAST_NM)
        planned = min(problem.torque_limits_Nm[limb, joint], peak)
        allowed = planned - max(_MORE * amount, _LEAST_EASED * planned)
        if allowed <= 0.0:
            return None
        limits[limb, joint], last[limb, joint] = (min(allowed, each[limb, joint]) for each in (limits, last))
    return replace(problem, torque_limits_Nm=limits, last_torques_Nm=last, surface_reserve_N=reserve_N)


def _peaks(loads: list[JointLoad], limb: str) -> list[float]:
    return [load.peak_torque_Nm for load in loads if load.limb == limb]


def bent(problem: WalkProblem, solution: WalkSolution, report: CheckReport) -> WalkProblem | None:
    """The walk without the corners in which joints are too fast; None where that is not what is wrong."""
    cuts = []
    for violation in report.violations:
        if (
            violation.constraint in ("joint_speed", "actuator_speed")
            and violation.limb is not None
            and violation.time_s is not None
        ):
            limb = LIMB_NAMES.index(violation.limb)
            cut = _cut(problem, solution, limb, int(violation.time_s / problem.dt_s))
            cuts += [] if cut is None else [cut]
    return replace(problem, cuts=(*problem.cuts, *cuts)) if cuts else None


def _cut(problem: WalkProblem, solution: WalkSolution, limb: int, knot: int) -> Cut | None:
    """What leaves out the corner that the foot is nearest to about a knot."""
    about = np.clip(np.arange(knot - 1, knot + 3), 0, problem.steps)
    feet = solution.feet(problem.step_height_m)[about, limb]
    rotation = rotation_from_rpy(solution.body[about, 3:6])
    places = np.einsum("kba,kb->ka", rotation, feet - solution.body[about, :3])
    centre, half = problem.boxes.centre_b_m[limb], problem.boxes.half_m
    shares = (places - centre) / half
    corner = shares[int(np.argmax((shares**2).sum(axis=1)))]
    if np.abs(corner).max() < _FAR:
        return None
    normal = corner / half
    return Cut(limb, normal, float(normal @ centre + (1.0 - _LEFT_OUT) * corner @ corner))
