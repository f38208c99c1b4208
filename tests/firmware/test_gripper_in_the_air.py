"""Fingers that meet nothing go where they are told without quivering: the gripper's image against a mass in the air."""

from __future__ import annotations

import numpy as np
from crux_contracts import can_codec
from crux_contracts.robot import load_robot
from emulated import GRIPPER, board
from host import TRACK

STEP_S = 0.001  # of the mass: finer than the bench's
CYCLES, MOVES_FROM, JUDGED_FROM = 350, 100, 200
CLOSED_M, OPEN_M = 0.03, 0.06
SMOOTH = 50  # steps
QUIVER_M = 5e-5


def test_fingers_move_smoothly() -> None:
    robot = load_robot("scaler")
    gripper = robot.gripper
    opening_m, speed_m_s = CLOSED_M, 0.0
    path_m = []
    with board(robot, 0, GRIPPER) as emulated:
        emulated.power_on(opening_m)
        for cycle in range(CYCLES):
            wanted_m = OPEN_M if cycle >= MOVES_FROM else CLOSED_M
            command: can_codec.Values = {
                "Mode": TRACK,
                "Opening_m": wanted_m,
                "SpeedLimit_m_s": gripper.max_finger_speed_m_s,
                "ForceLimit_N": gripper.max_finger_force_N,
            }
            counter = (cycle + 1) % 256
            for frame in (
                can_codec.encode("GripperCommand", command, counter),
                can_codec.encode("Sync", {"Cycle": cycle}, counter),
            ):
                emulated.hear(frame.identifier, frame.data)
            for _ in range(round(robot.dt_s / STEP_S)):
                force_N = emulated.control(STEP_S, opening_m)  # of a finger, positive closes
                drag = 1 + STEP_S * gripper.screw_damping_Ns_m / gripper.moving_mass_kg
                speed_m_s = (speed_m_s - STEP_S * force_N / gripper.moving_mass_kg) / drag
                opening_m += STEP_S * speed_m_s
                path_m.append(opening_m)
        assert emulated.fault == ""
    path = np.array(path_m)
    moved_m = path[-1] - path[0]
    passed_s = (CYCLES - MOVES_FROM) * robot.dt_s
    assert abs(moved_m - gripper.max_finger_speed_m_s * passed_s) < 0.1 * moved_m
    away = path - np.convolve(path, np.ones(SMOOTH + 1) / (SMOOTH + 1), "same")
    judged = away[round(JUDGED_FROM * robot.dt_s / STEP_S) : -SMOOTH]
    assert np.abs(judged).max() < QUIVER_M
