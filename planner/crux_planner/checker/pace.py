"""The robot's pace in a climb whose knots have times of their own: what happens in an interval has the time it needs.

The shares of an interval are those of msgs/PLAN.md.
"""

import numpy as np
from crux_contracts import N_LIMBS
from crux_contracts.robot import Robot

from crux_planner.checker.contact import swings
from crux_planner.checker.geometry import Array
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings

_ROUNDING = 1e-9


def check_pace(plan: PlanArrays, robot: Robot, findings: Findings) -> None:
    """Speed and acceleration of a gripper that lifts and comes down, the fingers' speed in the air, and the time in
    which a limb gives off its load and takes it up.
    """
    pace, most_m_s = robot.pace, robot.gripper.max_finger_speed_m_s
    start_s = plan.time_s
    series: dict[str, Array] = {
        name: np.full((plan.n_knots, N_LIMBS), -np.inf)
        for name in ("lift_speed", "lift_acceleration", "finger_speed", "load_time")
    }

    def moves(k: int, limb: int, share: float) -> None:
        """A smooth step over a share of the interval: peaks at 3/2 of its mean speed, and 6 ways by time squared."""
        way_m = float(np.linalg.norm(plan.gripper_position[k + 1, limb] - plan.gripper_position[k, limb]))
        took_s = share * plan.step_s[k]
        series["lift_speed"][k, limb] = 1.5 * way_m / took_s - pace.swing_speed_m_s
        series["lift_acceleration"][k, limb] = 6.0 * way_m / took_s**2 - pace.swing_acceleration_m_s2

    lifts, comes, opens = (0.6, 0.6, 1.0) if plan.fingers_move else (0.5, 0.55, 0.5)
    finger_m_s = 0.5 * np.abs(np.diff(plan.separation, axis=0)) / plan.step_s[:, None]
    for swing in swings(plan):
        limb, first, last = swing.limb, swing.first, swing.last
        moves(first, limb, lifts)
        series["finger_speed"][first:last, limb] = finger_m_s[first:last, limb] - most_m_s
        series["finger_speed"][first, limb] = finger_m_s[first, limb] / opens - most_m_s
        if last < plan.n_knots - 1:
            moves(last, limb, comes)
            if plan.fingers_move:
                series["finger_speed"][last, limb] = finger_m_s[last, limb] - most_m_s
        for k, share in ((first - 1, 0.45), (last + 1, 0.4)):
            if 0 <= k < plan.n_knots - 1:
                series["load_time"][k, limb] = pace.load_time_s - share * plan.step_s[k]
    units = {"lift_speed": "m/s", "lift_acceleration": "m/s2", "finger_speed": "m/s", "load_time": "s"}
    for name, values in series.items():
        for limb in range(N_LIMBS):
            findings.add_series(name, values[:, limb], start_s, units[name], tolerance=_ROUNDING, limb=limb)
