"""Which gains keep the admittance of a robot description stable against what it presses on, and how quick a pull on a
new grasp its force sensors see.

The loop and the criterion are those of runtime/core/robot/stability.hpp.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from .robot_bounds import GAIN_MARGIN, MAX_DELAY_CYCLES
from .robot_types import Robot
from .yaml_document import Problem

_HALVINGS, _FINE = 24, 1e-4  # of the span between no damping and enough


def gain_problems(robot: Robot) -> Iterator[Problem]:
    """What is wrong with section admittance, and with the rate of the pull on a new grasp."""
    a = robot.admittance
    most_s = MAX_DELAY_CYCLES / robot.can.rate_Hz
    if a.delay_s > most_s:
        yield Problem("admittance.delay_s", f"{a.delay_s:g}", f"expected at most {most_s:g}: {MAX_DELAY_CYCLES} cycles")
        return
    loops = (
        ("damping_Ns_m", a.damping_Ns_m, a.mass_kg, a.stiffness_N_m, "environment_N_m", a.environment_N_m),
        (
            "rotational_damping_Nms_rad",
            a.rotational_damping_Nms_rad,
            a.inertia_kg_m2,
            a.rotational_stiffness_Nm_rad,
            "environment_Nm_rad",
            a.environment_Nm_rad,
        ),
    )
    for key, damping, mass, spring, environment, stiffness in loops:
        least = least_damping(mass, spring, stiffness, a.delay_s)
        if damping < least:
            why = f"stable against {GAIN_MARGIN:g} times {environment}, felt {a.delay_s:g} s late"
            yield Problem(f"admittance.{key}", f"{damping:g}", f"expected at least {least:.4g}: {why}")
    rate, most = robot.grasp_test.rate_N_s, robot.control.unload_force_N / robot.control.force_filter_s
    if rate > most:
        why = "control.unload_force_N over control.force_filter_s"
        yield Problem("grasp_test.rate_N_s", f"{rate:g}", f"expected at most {most:.4g}: {why}")


def least_damping(mass: float, spring: float, stiffness: float, delay_s: float) -> float:
    """The least damping that is stable against GAIN_MARGIN times `stiffness`; within 1e-4, on the safe side."""
    hardest = GAIN_MARGIN * stiffness
    low, high = 0.0, 2 * hardest * delay_s + 2 * math.sqrt(mass * (hardest + spring))
    for _ in range(_HALVINGS):
        if high - low <= _FINE * high:
            break
        middle = (low + high) / 2
        if _stable(mass, middle, spring, hardest, delay_s):
            high = middle
        else:
            low = middle
    return high


def _stable(mass: float, damping: float, spring: float, stiffness: float, delay_s: float) -> bool:
    b = damping * damping - 2 * spring * mass
    c = stiffness * stiffness - spring * spring
    if c <= 0:
        return b >= 0
    root = math.sqrt(b * b + 4 * mass * mass * c)
    u = 2 * c / (b + root) if b > 0 else (root - b) / (2 * mass * mass)
    omega_1_s = math.sqrt(u)
    return math.atan2(damping * omega_1_s, spring - mass * u) + omega_1_s * delay_s < math.pi
