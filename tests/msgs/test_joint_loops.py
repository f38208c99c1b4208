"""The delay margin of the joints' position loops: against Pinocchio's mass matrix and a loop that is run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from crux_contracts.joint_loop_checks import Array, JointLoops, joint_inertia, joint_loops, postures
from crux_contracts.robot import load_robot, robot_names


def test_the_mass_matrix_is_pinocchios() -> None:
    robot = load_robot("scaler")
    model = pinocchio.buildModelFromUrdf(str(robot.urdf_path))
    data = model.createData()
    random = np.random.default_rng(0)
    for limb in robot.limbs:
        columns = [model.joints[model.getJointId(name)].idx_v for name in limb.joint_names]
        for q_rad in random.uniform(limb.lower_rad, limb.upper_rad, (10, 6)):
            q = np.zeros(model.nq)
            q[columns] = q_rad
            upper = np.triu(pinocchio.crba(model, data, q))
            expected = (upper + np.triu(upper, 1).T)[np.ix_(columns, columns)]
            np.testing.assert_allclose(joint_inertia(robot.urdf, limb, q_rad), expected, atol=1e-12)


def energy_after(loops: JointLoops, inertia: Array, delay_s: float, seconds: float) -> float:
    """Of the joints' motion, some time after they were let go off their setpoint, against that at half of the time."""
    dt_s = 5e-5
    steps, late = round(seconds / dt_s), round(delay_s / dt_s)
    inverse = np.linalg.inv(inertia)
    q, speed, torque = np.full(6, 0.01), np.zeros(6), np.zeros(6)
    asked = np.zeros((steps + late, 6))
    largest = np.zeros(steps)
    for i in range(steps):
        asked[i + late] = -loops.position * q - loops.velocity * speed
        torque = torque + dt_s / loops.lag_s * (asked[i] - torque)
        speed = speed + dt_s * inverse @ (torque - loops.damping * speed)
        q = q + dt_s * speed
        largest[i] = speed @ inertia @ speed
    return float(largest[steps * 3 // 4 :].max() / largest[steps // 4 : steps // 2].max())


@pytest.mark.parametrize("posture", [0, 4, 12])
def test_a_loop_that_is_run_oscillates_from_the_margin_on(posture: int) -> None:
    robot = load_robot("scaler")
    loops = joint_loops(robot, robot.limbs[0], np.array(list(postures(robot.limbs[0]))))
    margin_s = loops.delay_margins_s()[posture]
    assert energy_after(loops, loops.inertia[posture], 0.95 * margin_s, 1.6) < 0.7
    assert energy_after(loops, loops.inertia[posture], 1.05 * margin_s, 1.6) > 1.5


@pytest.mark.parametrize("name", robot_names())
def test_shipped_gains_bear_four_milliseconds_twice_in_every_posture(name: str) -> None:
    robot = load_robot(name)
    limb = robot.limbs[0]
    own = len(limb.joints)
    anywhere = np.random.default_rng(0).uniform(limb.lower_rad[:own], limb.upper_rad[:own], (150, own))
    assert robot.servo.dead_time_s >= 0.004
    assert joint_loops(robot, robot.limbs[0], anywhere).delay_margins_s().min() >= 0.008


def test_damping_that_is_too_hard_is_not_borne() -> None:
    robot = load_robot("scaler")
    limb = robot.limbs[0]
    anywhere = np.random.default_rng(0).uniform(limb.lower_rad, limb.upper_rad, (12, 6))
    loops = replace(
        joint_loops(robot, robot.limbs[0], anywhere),
        position=np.repeat([100.0, 60.0], 3),
        velocity=np.repeat([4.0, 1.0], 3),
    )
    assert 0.003 < loops.delay_margins_s().min() < 0.004
