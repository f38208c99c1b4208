"""Plans spoilt on purpose, and what is expected of the report about them."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_planner.checker import CheckReport, Violation, check_plan

from . import synthetic

ROBOT = load_robot("scaler")
VALID = synthetic.make_plan()
LF, RF, LR, RR = range(4)
NAMES = ("LF", "RF", "LR", "RR")
E = np.array([np.cos(synthetic.YAW_RAD), np.sin(synthetic.YAW_RAD), 0.0])
T = np.array([-E[1], E[0], 0.0])
DT = synthetic.DT_S


def broken(change: Callable[[plan_t], None]) -> CheckReport:
    plan = copy.deepcopy(VALID)
    change(plan)
    return check_plan(synthetic.sign(plan), ROBOT)


def only(report: CheckReport, constraint: str) -> list[Violation]:
    found = [v for v in report.violations if v.constraint == constraint]
    assert found, f"{constraint} not reported, but {sorted({v.constraint for v in report.violations})}"
    return found


def the(report: CheckReport, constraint: str, limb: int | None, finger: int | None, knot: int | None) -> Violation:
    """The one violation of that constraint, of the right limb, finger and knot."""
    found = only(report, constraint)
    assert len(found) == 1, found
    expected = (None if limb is None else NAMES[limb], finger, None if knot is None else knot * DT)
    assert (found[0].limb, found[0].finger, found[0].time_s) == expected
    return found[0]


def add(message: Any, field: str, index: int, amount: float) -> None:
    """Add to one entry of an array field."""
    values = list(getattr(message, field))
    values[index] += amount
    setattr(message, field, values)


def push(plan: plan_t, knot: int, limb: int, finger: int, force: np.ndarray) -> None:
    """Add a force to one finger."""
    for axis in range(3):
        add(plan.knots[knot].limbs[limb], "finger_force_w_n", 3 * (finger - 1) + axis, float(force[axis]))


def twist(plan: plan_t, knot: int, limb: int, finger: int, moment: np.ndarray) -> None:
    """Add a moment to one finger, or to both for finger 0."""
    for f in (1, 2) if finger == 0 else (finger,):
        for axis in range(3):
            add(plan.knots[knot].limbs[limb], "finger_moment_w_nm", 3 * (f - 1) + axis, float(moment[axis]))


def finger_force(plan: plan_t, knot: int, limb: int, finger: int) -> np.ndarray:
    """(3,)"""
    return np.array(plan.knots[knot].limbs[limb].finger_force_w_n[3 * finger - 3 : 3 * finger])


def move(plan: plan_t, limb: int, knots: slice, by: np.ndarray) -> None:
    """Move a gripper at some knots."""
    for knot in plan.knots[knots]:
        position = np.array(knot.limbs[limb].gripper_position_w_m)
        knot.limbs[limb].gripper_position_w_m = (position + by).tolist()
