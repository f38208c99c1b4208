"""The figures of a log against what the made-up climb put into it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from crux_tools.telemetry import read_log
from crux_tools.telemetry.margins import measured_margin_n, planned_margin_n, split_between_fingers
from crux_tools.telemetry.summary import summarise
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from made_up_climb import CYCLE_S, DT_S, GRASP_FORCE_N, N_KNOTS, ROUGHER, SLOPE_RAD, WEIGHT_N, Story, made_up_plan

STORY = Story()
FILTER_S = 0.008
PLAN_S = (N_KNOTS - 1) * DT_S


def test_states_and_their_times(log_path: Path) -> None:
    summary = summarise(read_log(log_path))
    begin, end = STORY.ready_cycles * CYCLE_S, STORY.ready_cycles * CYCLE_S + PLAN_S + STORY.wait_cycles * CYCLE_S
    assert [span.state for span in summary.states] == ["READY", "CLIMBING", "HOLDING"]
    assert [span.from_s for span in summary.states] == pytest.approx([0, begin, end])
    assert [span.to_s for span in summary.states] == pytest.approx([begin, end, end + STORY.holding_cycles * CYCLE_S])
    assert summary.plan_complete
    assert summary.final_state == "HOLDING"
    assert summary.plan_end_s == pytest.approx(PLAN_S)


def test_tracking_and_wrench_errors_are_those_put_in(log_path: Path) -> None:
    summary = summarise(read_log(log_path))
    assert summary.tracking.body_max_m == pytest.approx(math.hypot(*STORY.body_error_m))
    assert summary.tracking.body_rms_m == pytest.approx(math.hypot(*STORY.body_error_m))
    assert summary.tracking.body_max_deg == pytest.approx(0, abs=1e-6)
    for limb, expected in zip(summary.wrench, STORY.force_error_n.values(), strict=True):
        assert limb.force_rms_N == pytest.approx(math.hypot(*expected))
        assert limb.moment_rms_Nm == pytest.approx(0)
    stance_cycles = [0] * 4
    log = read_log(log_path)
    for row in range(len(log.time_s)):  # counted one by one, not as the summary does
        if log.state["supervisor_state"][row] == 2:
            for index in range(4):
                stance_cycles[index] += int(log.references["phase"][row, index] == 0)
    squares = [n * math.hypot(*e) ** 2 for n, e in zip(stance_cycles, STORY.force_error_n.values(), strict=True)]
    assert summary.force_rms_N == pytest.approx(math.sqrt(sum(squares) / sum(stance_cycles)))


def test_waits_missed_cycles_and_refusals(log_path: Path) -> None:
    summary = summarise(read_log(log_path))
    (wait,) = summary.waits
    assert (wait.limb, wait.reason, wait.count) == ("LF", "open", 1)
    assert wait.total_s == pytest.approx((STORY.wait_cycles - 1) * CYCLE_S)
    assert summary.missed_cycles == (summary.cycles - 1) // 100
    assert summary.refusals == ["not ready yet"]
    assert summary.faults == []


def test_timing_counts_as_real_time_only_when_the_clock_paced_it(log_path: Path, faulty_log_path: Path) -> None:
    lockstep, realtime = (summarise(read_log(path)).timing for path in (log_path, faulty_log_path))
    assert lockstep is not None
    assert realtime is not None
    assert not lockstep.realtime
    assert realtime.realtime
    assert realtime.period_us == pytest.approx([2000] * 4)
    assert realtime.late_us == pytest.approx([30] * 4)
    cycles = np.arange(1, summarise(read_log(log_path)).cycles)
    assert lockstep.compute_us[0] == pytest.approx(float(np.median(100_000 + cycles)) / 1e3)
    assert lockstep.compute_us[3] == pytest.approx((100_000 + cycles[-1]) / 1e3)


def test_a_fault_is_told_with_its_text(faulty_log_path: Path) -> None:
    (fault,) = summarise(read_log(faulty_log_path)).faults
    assert fault.time_s == pytest.approx(200 * CYCLE_S)
    assert (fault.code, fault.name, fault.limb) == (7, "body_error", None)
    assert fault.text == "body is 0.07 m off its reference (limit: 0.06 m)"


def test_a_killed_log_has_figures_too(killed_log_path: Path) -> None:
    summary = summarise(read_log(killed_log_path))
    assert not summary.plan_complete
    assert summary.cycles > 100
    assert any("not closed" in remark for remark in summary.notes)


vectors = arrays(float, 3, elements=st.floats(-50, 50))


@given(vectors, vectors, st.floats(-math.pi, math.pi), st.floats(0.01, 0.06), st.floats(0, 60))
def test_the_fingers_shares_make_up_the_grippers_wrench(
    force: np.ndarray, moment: np.ndarray, yaw: float, half: float, squeeze: float
) -> None:
    axis = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    forces, moments = split_between_fingers(force, moment, axis, np.array(half), np.array(squeeze))
    about_centre = np.cross(half * axis, forces[0]) + np.cross(-half * axis, forces[1]) + moments.sum(axis=0)
    np.testing.assert_allclose(forces.sum(axis=0), force, atol=1e-9)
    np.testing.assert_allclose(about_centre, moment, atol=1e-9)
    assert (forces[0] @ axis - forces[1] @ axis) / 2 == pytest.approx(squeeze, abs=1e-9)
    assert moments[0] @ axis == pytest.approx(moments[1] @ axis)


def test_between_two_logged_wrenches_the_raw_reading_fills_in(log_path: Path) -> None:
    log = read_log(log_path)
    n, dt_s = len(log.time_s), float(log.inputs["dt_s"][0])
    turned = np.tile([math.cos(0.3), 0.0, 0.0, math.sin(0.3)], (n, 4, 1))  # 0.6 rad about z
    log.limbs["gripper_quaternion_w"] = turned
    log.limbs_fresh[:] = np.arange(n) % 10 == 0
    step = 103  # RF's sensor feels 4 N more along the gripper's x from here on
    log.inputs["ft_force_g_n"][step:, 3] = 4.0
    log.inputs["ft_force_g_n"][step + 3] = np.nan  # a lost reading: the runtime goes on with the one before
    filtered_N, alone = 0.0, read_log(log_path)
    alone.limbs["gripper_quaternion_w"] = turned
    for cycle in range(step, 110):
        filtered_N += (4.0 - filtered_N) * dt_s / (FILTER_S + dt_s)
        alone.limbs["force_w_n"][cycle, 1] += filtered_N * np.array([math.cos(0.6), math.sin(0.6), 0.0])
    expected = measured_margin_n(alone, FILTER_S)
    assert measured_margin_n(log, FILTER_S)[:110] == pytest.approx(expected[:110], nan_ok=True)
    assert np.ptp(expected[100:110, 1, 0]) > 1.0


def test_margins_by_hand(log_path: Path) -> None:
    plan = made_up_plan()
    margin = planned_margin_n(plan)
    # four in stance: a finger presses with grasp force ± half the pull up the slope, and carries half the lift off it
    up, off = WEIGHT_N * math.sin(SLOPE_RAD) / 8, WEIGHT_N * math.cos(SLOPE_RAD) / 8
    demand = max(off - plan.spine_shear_n, 0)
    presses = [GRASP_FORCE_N + up, GRASP_FORCE_N - up]
    assert margin[0, 1] == pytest.approx([2.2 * presses[0] - demand, ROUGHER * presses[1] - demand])
    assert margin[0, 2] == pytest.approx([2.2 * press - demand for press in presses])
    assert np.isnan(margin[3:5, 0]).all()
    assert not np.isnan(margin[:, 1:]).any()
    log = read_log(log_path)
    before, measured = measured_margin_n(log, FILTER_S)[[0, STORY.ready_cycles + 10]]
    assert np.isnan(before).all()
    error = STORY.force_error_n[3][2] / 2  # of RR, off the wall: only the demand grows
    assert measured[3] == pytest.approx(margin[0, 3] - error)
