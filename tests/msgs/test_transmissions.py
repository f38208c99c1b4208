"""Actuators and joints: there and back, power, slopes by differences, and limits that hold whatever the joints do."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.transmissions import Limits, Transmission, own_limits
from crux_msgs.robot_keys import Transmissions
from hypothesis import given, settings
from hypothesis import strategies as st

JOINTS = 6
SIGNED = st.floats(0.2, 5.0).flatmap(lambda size: st.sampled_from([size, -size]))


@st.composite
def sections(draw: st.DrawFn) -> Transmissions:
    """A section with coupled actuators that move every joint."""
    each = [draw(SIGNED) for _ in range(JOINTS)]
    offsets = [draw(st.floats(-1.0, 1.0)) for _ in range(JOINTS)]
    to, by = [0.0] * JOINTS, [0.0] * JOINTS
    for j in draw(st.sets(st.integers(1, JOINTS - 1), max_size=3)):
        to[j], by[j] = float(draw(st.integers(1, j))), draw(SIGNED)
    return Transmissions(tuple(each), tuple(offsets), tuple(to), tuple(by))


def joints(seed: int, count: int = 20) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (count, JOINTS))


def limits(seed: int, low: float, high: float) -> Limits:
    random = np.random.default_rng(seed)
    ends = random.uniform(low, high, (3, JOINTS))
    return Limits(-ends[0], ends[0], ends[1], ends[2])


@given(sections(), st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_there_and_back_with_the_same_power(section: Transmissions, seed: int) -> None:
    by, q, torque, dq = Transmission.of(section, JOINTS), joints(seed), joints(seed + 1), joints(seed + 2)
    np.testing.assert_allclose(by.joints_rad(by.actuators_rad(q)), q, atol=1e-9)
    actuators = by.actuator_torque_Nm(q, torque)
    np.testing.assert_allclose(by.joint_torque_Nm(q, actuators), torque, atol=1e-9)
    step = 1e-6
    speeds = (by.actuators_rad(q + step * dq) - by.actuators_rad(q - step * dq)) / (2 * step)
    np.testing.assert_allclose((by.slope(q) @ dq[..., None])[..., 0], speeds, atol=1e-6)
    np.testing.assert_allclose((actuators * speeds).sum(axis=1), (torque * dq).sum(axis=1), atol=1e-4, rtol=1e-6)
    gains = np.abs(joints(seed + 3, 1)[0])
    pulled = (by.joint_stiffness_Nm_rad(q, gains) @ dq[..., None])[..., 0]
    np.testing.assert_allclose(pulled, by.joint_torque_Nm(q, gains * speeds), atol=1e-4)


@given(sections(), st.integers(0, 1000))
@settings(max_examples=60, deadline=None)
def test_actuators_keep_their_limits_whatever_the_joints_do_within_theirs(section: Transmissions, seed: int) -> None:
    by, actuators = Transmission.of(section, JOINTS), limits(seed, 3.0, 9.0)
    wide = limits(seed + 1, 0.5, 2.0)
    left = by.within(wide, actuators)
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * JOINTS)).reshape(JOINTS, -1).T
    q = np.where(corners > 0, left.high_rad, left.low_rad)
    there, reached = by.actuators_rad(q), by.reached(left, wide, actuators)
    if (left.low_rad < left.high_rad).all():
        assert (there <= actuators.high_rad + 1e-9).all()
        assert (there >= actuators.low_rad - 1e-9).all()
        np.testing.assert_allclose(there.max(axis=0), reached.high_rad, atol=1e-9)
        np.testing.assert_allclose(there.min(axis=0), reached.low_rad, atol=1e-9)
    speeds, torques = (corners * left.speed_rad_s) @ by.matrix.T, by.actuator_torque_Nm(q, corners * left.torque_Nm)
    for found, most, wholly in (
        (speeds, actuators.speed_rad_s, reached.speed_rad_s),
        (torques, actuators.torque_Nm, reached.torque_Nm),
    ):
        assert (found.max(axis=0) <= most * (1 + 1e-9)).all()
        np.testing.assert_allclose(found.max(axis=0), wholly, rtol=1e-9)


def test_limits_of_one_joints_actuator_are_used_up_to_their_ends() -> None:
    section = Transmissions(
        ratio=(-2.0,) * 7, offset_rad=(0.5,) * 7, low_rad=(-1.5,) * 7, high_rad=(3.5,) * 7, torque_Nm=(4.0,) * 7
    )
    wide = Limits(np.full(6, -1.0), np.full(6, 9.0), np.full(6, 3.0), np.full(6, 20.0))
    left = Transmission.of(section, 6).within(wide, own_limits(section, 6))
    assert left.low_rad == pytest.approx(np.full(6, -1.0))  # 0.5 - 2 q = 2.5: the joint's own end
    assert left.high_rad == pytest.approx(np.full(6, 1.0))  # 0.5 - 2 q = -1.5
    assert left.speed_rad_s == pytest.approx(np.full(6, 3.0))
    assert left.torque_Nm == pytest.approx(np.full(6, 8.0))
