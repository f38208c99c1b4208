"""Balance within joint torques: the linear map against virtual work, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import inverse, rotation_from_rpy, rotation_z
from crux_planner.model.problem import turned_problem
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.torque_limits import TorqueLimits
from limb_forward import forward
from walls import scenario, two_rows


@pytest.mark.parametrize("rpy_rad", [(0.0, 0.0, 0.0), (0.1, -0.15, 0.2)], ids=["level", "tilted"])
@pytest.mark.parametrize("limb", range(4))
def test_torques_do_the_work_of_the_gripper_wrench(limb: int, rpy_rad: tuple[float, ...], robot: Robot) -> None:
    """tau . dq = -(F . dp + M . dphi) for every small dq: finite differences of the forward kinematics."""
    problem, to_h = build_problem(scenario(two_rows()), robot), rotation_from_rpy(np.array(rpy_rad))
    strength, place = TorqueLimits(problem, 1.0), np.array([0.02, -0.01, 0.18])
    contact = problem.contacts[problem.start_contacts[limb]]
    turned_strength = strength.turned(turned_problem(problem, np.array(rpy_rad)))
    rows, _, _ = turned_strength._torques((problem.start_contacts[limb],), to_h.T @ place)[0]
    model = robot.limbs[limb]
    q, reached = inverse(model, to_h.T @ (contact.centre_h_m - place), to_h.T @ rotation_z(contact.yaw_rad))
    assert reached
    wrench = np.array([3.0, -7.0, 0.4, 11.0])
    force = 2 * wrench[0] * contact.tangent + 2 * wrench[1] * np.array([0, 0, 1.0]) + wrench[3] * contact.axis
    moment = 2 * wrench[2] * contact.axis
    expected, step = np.zeros(6), 1e-6
    for joint in range(6):
        turned = q.copy()
        turned[joint] += step
        (p0, r0), (p1, r1) = forward(model, q), forward(model, turned)
        turn = (r1 @ r0.T - np.eye(3)) / step
        about = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        expected[joint] = -(force @ to_h @ (p1 - p0) / step + moment @ to_h @ about)
    np.testing.assert_allclose(rows @ wrench, expected, atol=1e-4)


def test_a_stance_that_friction_holds_and_motors_do_not(robot: Robot) -> None:
    """Three limbs on a slope while the body hangs out to the side of the missing one: a matter of tens of newtons."""
    problem = build_problem(scenario(two_rows()), robot)
    support, place = problem.start_contacts[:3], np.array([-0.12, -0.05, 0.165])
    assert StaticEquilibrium(problem, 0.9).position(support, place, place, place) is not None
    assert TorqueLimits(problem, 0.9).position(support, place, place, place) is None
    assert TorqueLimits(problem, 0.9).by_friction(support, place, place, place) is not None
    uphill = np.array([0.1, 0.03, 0.165])
    assert TorqueLimits(problem, 0.9).position(support, uphill, uphill, uphill) is not None
    low, high = np.array([-0.12, -0.05, 0.165]), np.array([0.1, 0.05, 0.2])
    found = TorqueLimits(problem, 0.9).position(support, low, high, place)
    assert found is not None
    assert (found > place + 0.01).any()
