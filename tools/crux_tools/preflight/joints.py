"""How late the joints' drives answer, and how late their gains bear."""

from __future__ import annotations

from crux_contracts.joint_loop_checks import borne_dead_time_s
from crux_contracts.robot import Robot
from crux_msgs import status_t

from crux_tools.operator_status import dead_times_of
from crux_tools.preflight.machine import BAD, GOOD, Finding

TOPIC = "joints"


def joints(robot: Robot, status: status_t | None) -> Finding:
    """`status`: of the runtime that controls the robot, if there is one: it has measured the drives."""
    borne_s = borne_dead_time_s(robot)
    bear = f"gains bear drives that answer {borne_s * 1e3:.1f} ms late"
    dead_s = {joint: late_s for joint, late_s in (dead_times_of(status) or {}).items() if late_s is not None}
    if not dead_s:
        stated = f"{robot.servo.dead_time_s * 1e3:g} ms are described"
        return Finding(TOPIC, GOOD, f"{bear}; {stated}, and measured when a runtime takes the robot over")
    latest = max(dead_s, key=dead_s.__getitem__)
    measured = f"{latest} answers {dead_s[latest] * 1e3:.0f} ms late, the others no later"
    if dead_s[latest] > borne_s:
        return Finding(TOPIC, BAD, f"{bear}; {measured}", "fix the drive, or describe it and lower the gains")
    return Finding(TOPIC, GOOD, f"{bear}; {measured}")
