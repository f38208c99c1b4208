"""Whether two turned boxes stand in each other, against a linear program for a common point."""

from __future__ import annotations

import math

import numpy as np
import pytest
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_contracts.turned_boxes import TurnedBox, axes_of, depth_m
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

angles = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)
places = st.tuples(*[st.floats(-0.15, 0.15)] * 3)
sizes = st.tuples(*[st.floats(0.02, 0.2)] * 3)


def meet(a: TurnedBox, b: TurnedBox) -> bool:
    rows, right = [], []
    for box in (a, b):
        axes, middle, half = np.array(box.axes), np.array(box.middle_m), np.array(box.half_m)
        rows += [axes, -axes]
        right += [axes @ middle + half, half - axes @ middle]
    found = linprog(np.zeros(3), np.vstack(rows), np.concatenate(right), bounds=[(None, None)] * 3)
    return bool(found.status == 0)


@settings(max_examples=60, deadline=None)
@given(places, sizes, angles, sizes, angles)
def test_depth_tells_whether_boxes_have_a_common_point(
    place: tuple[float, float, float],
    size: tuple[float, float, float],
    turn: tuple[float, float, float],
    other_size: tuple[float, float, float],
    other_turn: tuple[float, float, float],
) -> None:
    a, b = TurnedBox.on_foot((0.0, 0.0, 0.0), size, turn), TurnedBox.on_foot(place, other_size, other_turn)
    depth = depth_m(a, b)
    assume(abs(depth) > 1e-6)
    assert meet(a, b) == (depth > 0)
    assert depth_m(b, a) == pytest.approx(depth)


@given(angles)
def test_axes_are_those_of_roll_pitch_and_yaw(turn: tuple[float, float, float]) -> None:
    wanted = Rotation.from_euler("ZYX", turn[::-1]).as_matrix()
    np.testing.assert_allclose(np.array(axes_of(turn)).T, wanted, atol=1e-12)


@given(st.floats(-3.0, 3.0), st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)))
def test_a_gripper_is_turned_about_its_tilt_after_its_yaw(yaw: float, tilt: tuple[float, float]) -> None:
    turn = gripper_rotation(yaw, tilt)
    wanted = Rotation.from_rotvec([*tilt, 0.0]) * Rotation.from_euler("z", yaw)
    np.testing.assert_allclose(turn, wanted.as_matrix(), atol=1e-12)
    yaw_again, tilt_again = yaw_and_tilt(turn)
    assert yaw_again == pytest.approx(yaw, abs=1e-9)
    assert tilt_again == pytest.approx(tilt, abs=1e-9)
