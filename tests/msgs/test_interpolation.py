"""PLAN.md by hand: expected values are worked out from its text, not from the code."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.interpolation import PlanReference, gripper_wrench, smoothstep
from crux_msgs import limb_knot_t
from hypothesis import given
from hypothesis import strategies as st
from msgs_golden import sample_plan, sample_walk

LF, RF, RR = 0, 1, 3
LAST = 12  # intervals of the sample plan; LF swings over knots 2..4, RR over 8..9


@pytest.fixture(scope="module")
def reference() -> PlanReference:
    return PlanReference(sample_plan())


def test_body_passes_through_the_knots_without_overshoot(reference: PlanReference) -> None:
    plan = sample_plan()
    for knot in plan.knots:
        position, rpy = reference.body(knot.time_s)
        assert position == pytest.approx(knot.body_position_w_m)
        assert rpy == pytest.approx(knot.body_rpy_rad)
    for a, b in zip(plan.knots, plan.knots[1:], strict=False):
        between, _ = reference.body(np.linspace(a.time_s, b.time_s, 50))
        low = np.minimum(a.body_position_w_m, b.body_position_w_m)
        high = np.maximum(a.body_position_w_m, b.body_position_w_m)
        assert (between >= low - 1e-12).all()
        assert (between <= high + 1e-12).all()


def test_body_rates_are_the_derivative(reference: PlanReference) -> None:
    h = 1e-6
    for time_s in (0.7, 5.3, 11.9, 20.1):
        velocity, rates = reference.body_rates(time_s)
        after, before = reference.body(time_s + h), reference.body(time_s - h)
        assert velocity == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-7)
        assert rates == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-7)


def test_interior_slope_is_the_harmonic_mean_of_the_secants(reference: PlanReference) -> None:
    # Fritsch & Carlson on an even grid, where both secants have one sign.
    x = [knot.body_position_w_m[0] for knot in sample_plan().knots]
    left, right = (x[5] - x[4]) / 2.0, (x[6] - x[5]) / 2.0
    assert reference.body_rates(10.0)[0][0] == pytest.approx(2 / (1 / left + 1 / right))


def test_a_swing_rests_then_lifts_then_swings_then_descends(reference: PlanReference) -> None:
    plan = sample_plan()
    old, high, higher, new = (np.array(plan.knots[k].limbs[LF].gripper_position_w_m) for k in (2, 3, 4, 5))
    assert reference.limb(LF, 2, 0.3).position_w_m == pytest.approx(old)
    assert reference.limb(LF, 2, 0.75).position_w_m == pytest.approx((old + high) / 2)
    assert reference.limb(LF, 3, 0.25).position_w_m == pytest.approx(0.75 * high + 0.25 * higher)
    assert reference.limb(LF, 4, 0.275).position_w_m == pytest.approx((higher + new) / 2)
    assert reference.limb(LF, 4, 0.56).position_w_m == pytest.approx(new)
    assert reference.limb(LF, 5, 0.9).position_w_m == pytest.approx(new)


def test_fingers_open_at_once_and_close_late(reference: PlanReference) -> None:
    plan = sample_plan()
    half = [plan.knots[k].limbs[LF].finger_separation_m / 2 for k in range(6)]
    assert reference.limb(LF, 1, 0.99).opening_m == pytest.approx(half[1])
    assert reference.limb(LF, 2, 0.01).opening_m == pytest.approx(half[3])
    assert reference.limb(LF, 4, 0.59).opening_m == pytest.approx(half[4])
    assert reference.limb(LF, 4, 0.61).opening_m == pytest.approx(half[5])


def test_a_point_foot_swings_smoothly_from_rest_to_rest() -> None:
    plan = sample_walk()
    walk = PlanReference(plan)
    assert walk.point_feet
    assert not PlanReference(sample_plan()).point_feet
    for k in range(walk.intervals):  # through the knots
        assert walk.limb(LF, k, 0.0).position_w_m == pytest.approx(plan.knots[k].limbs[LF].gripper_position_w_m)
        assert walk.limb(LF, k, 1.0).position_w_m == pytest.approx(plan.knots[k + 1].limbs[LF].gripper_position_w_m)
    h = 1e-4  # LF swings over knots 2..5: at rest where it begins (2) and ends (6), on the ground before and after
    for k, u, side in ((2, 0.0, h), (5, 1.0, -h)):
        rate = (walk.limb(LF, k, u + side).position_w_m - walk.limb(LF, k, u).position_w_m) / (side * plan.dt_s)
        assert np.abs(rate).max() < 2e-3
    assert np.ptp(walk.limb(LF, 1, np.linspace(0, 1, 9)).position_w_m, axis=0).max() == 0.0
    # Inside, the slope is the harmonic mean of the secants (here between knots 3, 4 and 5).
    x = [knot.limbs[LF].gripper_position_w_m[0] for knot in plan.knots]
    left, right = (x[4] - x[3]) / 0.2, (x[5] - x[4]) / 0.2
    rate = (walk.limb(LF, 4, 1e-6).position_w_m - walk.limb(LF, 3, 1 - 1e-6).position_w_m) / (2e-6 * 0.2)
    assert rate[0] == pytest.approx(2 / (1 / left + 1 / right), rel=1e-4)
    assert (walk.limb(LF, 3, np.linspace(0, 1, 9)).opening_m == 0.01).all()


def test_gripper_wrench_by_hand() -> None:
    knot = limb_knot_t()
    knot.gripper_yaw_w_rad = np.pi / 2  # opening axis along y
    knot.finger_separation_m = 0.1
    knot.finger_force_w_n = [0.0, 20.0, 3.0, 0.0, -20.0, 1.0]
    knot.finger_moment_w_nm = [0.0, 0.5, 0.0, 0.0, 0.25, 0.0]
    # Arms (0, +-0.05, 0): moment about x is 0.05 * 3 - 0.05 * 1.
    assert gripper_wrench(knot) == pytest.approx([0, 0, 4, 0.1, 0.75, 0], abs=1e-12)


def test_wrenches_shift_before_a_limb_lets_go_and_after_it_grips(reference: PlanReference) -> None:
    knots = sample_plan().knots
    wrench = [gripper_wrench(knot.limbs[RF]) for knot in knots]
    # LF lets go at 2: all of RF's change to W(2) happens in interval 1, none in interval 2.
    assert reference.wrench(RF, 1, 0.49) == pytest.approx(wrench[1])
    assert reference.wrench(RF, 1, 0.725) == pytest.approx((wrench[1] + wrench[2]) / 2)
    assert reference.wrench(RF, 1, 0.95) == pytest.approx(wrench[2])
    assert reference.wrench(RF, 2, 0.0) == pytest.approx(wrench[2])
    # LF grips at 5: the change is made in the first part of interval 5.
    assert reference.wrench(RF, 5, 0.02) == pytest.approx(wrench[4])
    assert reference.wrench(RF, 5, 0.22) == pytest.approx((wrench[4] + wrench[5]) / 2)
    assert reference.wrench(RF, 5, 0.42) == pytest.approx(wrench[5])
    # The last knot has no wrench of its own: nothing to shift to at the end.
    assert reference.wrench(RF, LAST - 1, 1.0) == pytest.approx(wrench[LAST - 1])


def test_load_is_shared_out_as_planned(reference: PlanReference) -> None:
    assert reference.load(LF, 0, 0.5) == 1
    assert reference.load(LF, 1, 0.725) == pytest.approx(0.5)
    assert reference.load(LF, 1, 0.95) == pytest.approx(0)
    assert (reference.load(LF, 3, np.linspace(0, 1, 5)) == 0).all()
    assert reference.load(LF, 5, 0.22) == pytest.approx(0.5)
    assert reference.load(LF, 5, 0.42) == pytest.approx(1)


@given(limb=st.integers(0, 3), k=st.integers(0, LAST - 2))
def test_nothing_jumps_between_intervals(limb: int, k: int) -> None:
    reference = PlanReference(sample_plan())
    end, begin = reference.limb(limb, k, 1.0), reference.limb(limb, k + 1, 0.0)
    assert end.position_w_m == pytest.approx(begin.position_w_m)
    assert end.yaw_w_rad == pytest.approx(begin.yaw_w_rad)
    assert reference.wrench(limb, k, 1.0) == pytest.approx(reference.wrench(limb, k + 1, 0.0))
    assert reference.load(limb, k, 1.0) == pytest.approx(reference.load(limb, k + 1, 0.0))


def test_arrays_of_shares_agree_with_single_ones(reference: PlanReference) -> None:
    shares = np.linspace(0, 1, 9)
    for limb in (LF, RR):
        for k in range(LAST):
            together = reference.limb(limb, k, shares)
            for i, u in enumerate(shares):
                assert together.position_w_m[i] == pytest.approx(reference.limb(limb, k, u).position_w_m)
                assert together.opening_m[i] == reference.limb(limb, k, u).opening_m
            assert reference.wrench(limb, k, shares).shape == (9, 6)


def test_smoothstep_clips() -> None:
    assert smoothstep([-1.0, 0.0, 0.5, 1.0, 7.0]) == pytest.approx([0, 0, 0.5, 1, 1])


def test_times_become_intervals_and_shares(reference: PlanReference) -> None:
    assert reference.at(-1.0) == (0, 0.0)
    assert reference.at(3.0) == (1, 0.5)
    assert reference.at(4.0) == (2, 0.0)
    assert reference.at(1e6) == (LAST - 1, 1.0)


@pytest.mark.parametrize(
    ("swing", "says"), [((3, 3), "at knot 3 alone"), ((0, 2), "at the first knot"), ((9, 12), "at the last knot")]
)
def test_swings_that_make_no_sense_are_told(swing: tuple[int, int], says: str) -> None:
    with pytest.raises(ValueError, match=f"LF is in the air {says}"):
        PlanReference(sample_plan({"LF": swing}))
