"""The checker's own reading of msgs/PLAN.md against the one that planner's and runtime's golden vectors hold fast."""

import json
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.interpolation import PlanReference
from crux_msgs import plan_t
from crux_planner.checker.plan_arrays import PlanArrays, read_plan
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import pchip, sample, sample_at
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from . import synthetic

PLAN = synthetic.make_plan()
REFERENCE = PlanReference(PLAN)


def arrays() -> PlanArrays:
    read = read_plan(PLAN, Findings())
    assert read is not None
    return read


@pytest.mark.parametrize("k", range(synthetic.N_KNOTS - 1))
def test_equals_the_contracts_reading(k: int) -> None:
    u = np.linspace(0.0, 0.999, 97)
    samples = sample_at(arrays(), np.full(97, k), u)
    position, rpy = REFERENCE.body((k + u) * PLAN.dt_s)
    np.testing.assert_allclose(samples.body_position, position, atol=1e-12)
    np.testing.assert_allclose(samples.body_rpy, rpy, atol=1e-12)
    for limb in range(4):
        gripper = REFERENCE.limb(limb, k, u)
        np.testing.assert_allclose(samples.gripper_position[:, limb], gripper.position_w_m, atol=1e-12)
        np.testing.assert_allclose(samples.gripper_yaw[:, limb], gripper.yaw_w_rad, atol=1e-12)
        wrench = np.concatenate([samples.force[:, limb], samples.moment[:, limb]], axis=1)
        np.testing.assert_allclose(wrench, REFERENCE.wrench(limb, k, u), atol=1e-9)
        np.testing.assert_allclose(samples.load[:, limb], REFERENCE.load(limb, k, u), atol=1e-12)


@pytest.mark.parametrize("name", ["walking", "own_times", "moving_fingers", "tilted"])
def test_other_plans_equal_the_contracts_reading(name: str) -> None:
    """The golden walk, in which two limbs step at once, and the golden plans whose knots have times of their own."""
    golden = json.loads((Path(__file__).resolve().parents[3] / "msgs" / "golden" / f"{name}.json").read_text())
    plan = plan_t.decode(bytes.fromhex(golden["plan_lcm"]))
    read = read_plan(plan, Findings())
    assert read is not None
    for point in golden["samples"]:
        samples = sample_at(read, np.array([point["k"]]), np.array([point["u"]]))
        assert samples.body_position[0] == pytest.approx(point["body_position_w_m"], abs=1e-10)
        for limb, expected in enumerate(point["limbs"]):
            assert samples.gripper_position[0, limb] == pytest.approx(expected["gripper_position_w_m"], abs=1e-10)
            assert samples.gripper_yaw[0, limb] == pytest.approx(expected["gripper_yaw_w_rad"], abs=1e-10)
            assert samples.gripper_tilt[0, limb] == pytest.approx(expected["gripper_tilt_w_rad"], abs=1e-10)
            turn = gripper_rotation(expected["gripper_yaw_w_rad"], expected["gripper_tilt_w_rad"])
            np.testing.assert_allclose(samples.gripper_rotation[0, limb], turn, atol=1e-10)
            comes = not read.stance[point["k"], limb] and read.stance[point["k"] + 1, limb]
            if name == "walking" or (name == "moving_fingers" and comes and point["u"] < 0.6):  # others follow below
                assert samples.opening[0, limb] == pytest.approx(expected["finger_opening_m"])
            assert samples.load[0, limb] == pytest.approx(expected["load"], abs=1e-10)
            wrench = np.concatenate([samples.force[0, limb], samples.moment[0, limb]])
            assert wrench == pytest.approx(expected["wrench_w"], abs=1e-9)


@pytest.mark.parametrize("limb", range(4))
def test_fingers_are_followed_on_their_way_to_the_commanded_opening(limb: int) -> None:
    """The contracts command an opening at once; the checker sweeps from where the fingers were to there."""
    read = arrays()
    for k in range(synthetic.N_KNOTS - 1):
        u = np.linspace(0.0, 0.999, 97)
        opening = sample_at(read, np.full(97, k), u).opening[:, limb]
        commanded = REFERENCE.limb(limb, k, u).opening_m
        ends = read.separation[k : k + 2, limb] / 2
        assert opening.min() >= ends.min() - 1e-12
        assert opening.max() <= max(ends.max(), commanded.max()) + 1e-12
        assert abs(opening[-1] - commanded[-1]) < 1e-4


@given(st.integers(2, 12), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_pchip_equals_scipys(knots: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    values = random.normal(size=(knots, 3)) * random.integers(0, 2, size=(knots, 1))
    steps = random.uniform(0.1, 2.0, knots - 1) if seed % 2 else np.full(knots - 1, 0.7)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    k, u = random.integers(0, knots - 1, 40), random.uniform(0.0, 1.0, 40)
    expected = PchipInterpolator(times, values)(times[k] + u * steps[k])
    np.testing.assert_allclose(pchip(steps, values, k, u), expected, atol=1e-12)


def test_moments_are_close_together_where_a_limb_moves() -> None:
    samples = sample(arrays())
    assert samples.time_s[0] == 0.0
    assert samples.time_s[-1] == (synthetic.N_KNOTS - 1) * synthetic.DT_S
    steps = np.linalg.norm(np.diff(samples.gripper_position, axis=0), axis=2)
    assert steps.max() < 0.006
