"""How exactly a plan must meet each constraint: room for the finite tolerance of a numerical solver and nothing more.

Limits with a physical meaning of their own (clearances) say where they come from.
"""

FORCE_N = 1e-2
"""Forces and force residuals: 1/10,000 of the robot's weight."""

MOMENT_NM = 1e-3
"""Moments and moment residuals."""

LENGTH_M = 1e-4
"""Positions of fingers on faces, of steps of the body, of inverse kinematics: a tenth of what a pad notices."""

ANGLE_RAD = 1e-3
"""Orientations."""

SPEED_M_S = 1e-5
"""Linear speeds of the body and of grippers, m/s."""

RATE_RAD_S = 1e-5
"""Angular speeds of the body and of grippers, rad/s."""

OF_UNIT = {
    "m": LENGTH_M,
    "rad": ANGLE_RAD,
    "m/s": SPEED_M_S,
    "rad/s": RATE_RAD_S,
    "m/s or rad/s": SPEED_M_S,
    "N": FORCE_N,
    "N m": MOMENT_NM,
}
"""Of every constraint that has none of its own; 0 for other units."""

TORQUE_NM = 1e-2
"""Joint torques."""

MATCH_REL = 1e-9
"""Numbers that a plan copies from its scenario must be the same numbers."""

MOVING_CLEARANCE_M = 0.003
"""What a moving finger, palm or link keeps to every body it does not grip: half of the 5 mm by which a hold may stand
off its place, met already at the knots by the planner's 24 mm for pad centres."""

FRICTION_CONE_BETWEEN_KNOTS_N = 0.5
"""Finger force that a correction between knots may want beyond the limit; the controller keeps 4 N in reserve."""
