"""What a sane robot is within. The runtime has these numbers from here, by way of msgs/generate."""

from __future__ import annotations

import math

# Joint axes the closed-form kinematics stand on: yaw, pitch, pitch, then a spherical wrist pitch, roll, yaw.
JOINT_AXES = ((0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
JOINTS = len(JOINT_AXES)  # of a limb that puts its gripper anywhere
LEAST_JOINTS, MOST_JOINTS = 4, 7  # of a limb; messages, nodes and logs have MOST_JOINTS slots for each
GRIPPER_NODE = 7  # on a limb's bus; joints count from 1 and leave it out
LEAST_PLACED_M3 = 1e-6  # determinant of a limb's joints and of the turns that it lacks
STILL_RAD = 1e-4  # by which a gripper may be turned in a way that its limb has no joint for
ALIKE = 1e-9  # components of axes, lengths [m] and angles [rad] that count as equal

MAX_LENGTH_M = 3.0
MAX_ANGLE_RAD = 4 * math.pi
MAX_SPEED = 100.0  # rad/s or m/s
MAX_EFFORT = 10_000.0  # Nm or N
MIN_MASS_KG = 1e-4  # of a link that moves
MAX_MASS_KG = 100.0
MIN_GYRATION_M = 1e-4  # radius of gyration about any axis
MAX_GYRATION_M = 1.0

FIVE_BAR_STEPS = 96  # of a joint's range, in which the ranges that a five-bar leaves are looked for
CRANK_TURN_RAD = 3.0  # a five-bar's crank turns no further from where it is with its joints in their middle
PARALLEL = 1e-6  # sine of the angle between axes that count as parallel
SHORT_M = 1e-6  # what counts as no length
FLAT = 1e-3  # least sine that slopes of a five-bar are reckoned with

GAIN_MARGIN = 2.0  # so many times stiffer than described may be what a gripper meets
MAX_DELAY_CYCLES = 64  # until what the admittance does is felt: as long as calibration remembers

DEAD_TIME_MARGIN = 2.0  # so many times later than servo.dead_time_s may a joint answer before its loop oscillates
LOOP_LOWEST_1_S, LOOP_HIGHEST_1_S = 0.1, 1e5  # between which joint loops cross over
LOOP_HALVINGS = 16  # of that band, on a logarithmic scale: within 0.03 %
LOOP_STEP, LOOP_STEPS = 0.9, 20  # of gains that are looked for in place of those that are refused
