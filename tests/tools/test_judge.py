"""The judge on made-up runs whose slips, falls and errors are known."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from crux_contracts.interpolation import PlanReference
from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_simulation.sim.judge import Tracking, Verdict, judge, long_runs, pad_travel, track
from crux_simulation.sim.recorder import Truth
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry.rotations import rotation_from_rpy
from hand_plan import BODY_HEIGHT_M, NOMINAL_M, PAD_HEIGHT_M, Wall, climbing_plan, standing_plan
from hypothesis import given
from hypothesis import strategies as st

SAMPLES = 100
PERIOD = 5
PLAN = standing_plan(Wall())
MODEL = build_model(load_robot("scaler"), PLAN)
GRIPPERS = np.column_stack([NOMINAL_M, np.full(4, PAD_HEIGHT_M)])
FACE = [next(i for i, face in enumerate(MODEL.faces) if face.hold == hold) for hold in range(4)]
WEIGHT_N = 3.0
CYCLE_S = 0.002


def make_truth(samples: int = SAMPLES) -> Truth:
    """Everything in its place, every pad pressing with 20 N."""
    pads = np.repeat(GRIPPERS, 2, axis=0) + np.tile([[0.042, 0, 0], [-0.042, 0, 0]], (4, 1))
    hand_mass = MODEL.model.body_subtreemass[MODEL.gripper_bodies]
    wrench = np.zeros((samples, 4, 6))
    wrench[:, :, :3] = np.array([0, 0, WEIGHT_N]) + hand_mass[:, None] * np.array(PLAN.gravity_w_m_s2)
    return Truth(
        cycle=1 + np.arange(samples) * PERIOD,
        body_position_m=np.tile([0, 0, BODY_HEIGHT_M], (samples, 1)),
        body_quaternion=np.tile([1.0, 0, 0, 0], (samples, 1)),
        gripper_position_m=np.tile(GRIPPERS, (samples, 1, 1)),
        gripper_rotation=np.tile(np.eye(3), (samples, 4, 1, 1)),
        pad_position_m=np.tile(pads, (samples, 1, 1)),
        pad_force_n=np.full((samples, 8), 20.0),
        pad_face=np.tile(np.repeat(FACE, 2), (samples, 1)),
        hand_wrench_g=wrench,
        link_contact_force_n=np.zeros(samples),
        climbing=np.ones(samples, dtype=np.int64),
    )


def make_log() -> Any:
    """The runtime climbs from cycle 0 on, all limbs in stance."""
    cycles = SAMPLES * PERIOD
    state = np.zeros(
        cycles,
        dtype=[("cycle", "i8"), ("plan_time_s", "f8"), ("supervisor_state", "i1")],
    )
    state["cycle"] = 1 + np.arange(cycles)
    state["plan_time_s"] = state["cycle"] * CYCLE_S
    state["supervisor_state"] = 2
    references = np.zeros((cycles, 4), dtype=[("phase", "i1"), ("load", "f8"), ("gripper_position_w_m", "f8", 3)])
    references["load"] = 1.0
    references["gripper_position_w_m"] = GRIPPERS
    limbs = np.zeros((cycles, 4), dtype=[("force_reference_w_n", "f8", 3)])
    limbs["force_reference_w_n"] = [0, 0, WEIGHT_N]
    fresh = np.arange(cycles) % (2 * PERIOD) == 0
    return SimpleNamespace(state=state, references=references, limbs=limbs, limbs_fresh=fresh)


def cut(log: Any, rows: slice) -> Any:
    return SimpleNamespace(**{name: table[rows] for name, table in vars(log).items()})


def verdict_on(truth: Truth, plan: plan_t = PLAN, complete: bool = True) -> Verdict:
    return judge(truth, plan, MODEL, complete)


def tracked(truth: Truth, log: Any = None) -> Tracking:
    return track(truth, log or make_log(), 0, PLAN, MODEL)


def test_a_perfect_run() -> None:
    verdict, tracking = verdict_on(make_truth()), tracked(make_truth())
    assert verdict.reached_goal
    assert not verdict.fell
    assert not verdict.lost_grips
    assert verdict.slips == 0
    assert tracking.body_max_m == tracking.finger_max_m == verdict.goal_error_m == 0.0
    assert tracking.force_rms_n == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("moved_m", "slips"), [(0.0049, 0), (0.0051, 1)])
@pytest.mark.parametrize("axis", [1, 2])
def test_tangential_motion_of_a_loaded_pad_is_a_slip(moved_m: float, slips: int, axis: int) -> None:
    truth = make_truth()
    truth.pad_position_m[50:, 3, axis] += moved_m
    assert verdict_on(truth).slips == slips


def test_motion_along_the_normal_or_unloaded_is_no_slip() -> None:
    truth = make_truth()
    truth.pad_position_m[50:, 3, 0] += 0.01  # along the opening axis: the face moved in, nothing slid
    truth.pad_force_n[40:60, 5] = 0.0  # let go, moved, took hold again
    truth.pad_face[40:60, 5] = -1
    truth.pad_position_m[50:, 5, 1] += 0.05
    assert verdict_on(truth).slips == 0


def test_sliding_on_the_wall_is_no_slip_on_a_hold() -> None:
    truth = make_truth()
    truth.pad_face[:, 2] = 0
    assert MODEL.face_hold[0] == -1
    truth.pad_position_m[50:, 2, 1] += 0.05
    assert max(pad_travel(truth, MODEL.face_hold, 5.0)) == 0.0


def test_a_body_far_from_its_reference_fell() -> None:
    truth = make_truth()
    truth.body_position_m[50:60, 2] -= 0.11
    verdict = verdict_on(truth)
    assert verdict.fell
    assert "body" in verdict.fall_reason
    assert tracked(truth).body_max_m == pytest.approx(0.11)


@pytest.mark.parametrize(("climbs", "grips", "fell"), [(0, 4, False), (0, 3, True), (1, 4, True)])
def test_a_body_that_hangs_limp_by_all_its_grips_has_not_fallen(climbs: int, grips: int, fell: bool) -> None:
    truth = make_truth()
    truth.body_position_m[50:90, 2] -= 0.15
    truth.climbing[40:] = climbs
    truth.pad_face[50:90, 2 * grips :] = -1
    assert verdict_on(truth).fell == fell


@pytest.mark.parametrize(("samples", "lost"), [(9, False), (12, True)])
def test_a_limb_without_its_hold_in_stance_lost_its_grip_and_the_robot_has_not_fallen(samples: int, lost: bool) -> None:
    truth = make_truth()
    truth.pad_face[50 : 50 + samples, 6] = -1
    verdict = verdict_on(truth)
    assert list(verdict.lost_grips) == ["RR"] * lost
    assert (verdict.fell, verdict.fall_reason) == (False, "")


@pytest.mark.parametrize("away_m", [175.0, np.nan])
def test_a_robot_that_came_off_before_it_could_start_fell(away_m: float) -> None:
    truth = make_truth()
    truth.climbing[:] = 0
    assert not verdict_on(truth, complete=False).fell
    truth.body_position_m[30:, 2] -= away_m
    verdict = verdict_on(truth, complete=False)
    assert verdict.fell
    assert "off its path at" in verdict.fall_reason


def swing_truth(plan: plan_t, let_go: float, landed: float, late_s: float = 0.0) -> Truth:
    """A run of `plan`, in which LF is off its hold between two times and everything else stays in its place.

    What the plan wants after LF's landing comes `late_s` later: so long the clock stood still.
    """
    step_s, end_s = PERIOD * CYCLE_S, plan.knots[-1].time_s + late_s
    truth = make_truth(round(end_s / step_s))
    time_s = (truth.cycle - truth.cycle[0]) * CYCLE_S
    truth.body_position_m[:] = PlanReference(plan).body(np.where(time_s < landed, time_s, time_s - late_s))[0]
    away = (time_s >= let_go) & (time_s < landed)
    truth.pad_face[away, :2] = -1
    truth.pad_force_n[away, :2] = 0.0
    return truth


@pytest.mark.parametrize(
    ("early_s", "late_s", "lost"),
    [(0.0, 0.0, False), (-0.05, 1.5, False), (0.3, 0.0, False), (0.3, 4.0, False), (-2.5, 0.0, True)],
)
def test_a_limb_may_leave_its_hold_where_the_plan_lets_it_go_and_the_plan_waits_for_it(
    early_s: float, late_s: float, lost: bool
) -> None:
    plan = climbing_plan(limbs_to_move=(0,))
    air = [k for k, knot in enumerate(plan.knots) if knot.limbs[0].phase]
    lets_go_s, takes_hold_s = plan.knots[air[0]].time_s, plan.knots[air[-1] + 1].time_s
    truth = swing_truth(plan, lets_go_s + early_s, takes_hold_s - 0.3 + late_s, late_s)
    verdict = verdict_on(truth, plan)
    assert list(verdict.lost_grips) == ["LF"] * lost


def test_a_gripper_that_touches_the_wall_before_it_grips_is_not_on_its_hold_yet() -> None:
    plan = climbing_plan(limbs_to_move=(0,))
    air = [k for k, knot in enumerate(plan.knots) if knot.limbs[0].phase]
    takes_hold_s = plan.knots[air[-1] + 1].time_s
    truth = swing_truth(plan, plan.knots[air[0]].time_s, takes_hold_s + 4.0, late_s=4.2)
    touches = round((takes_hold_s + 1.0) / (PERIOD * CYCLE_S))
    truth.pad_face[touches : touches + 20, :2] = 0
    assert not verdict_on(truth, plan).lost_grips


def test_a_limb_that_loses_its_hold_after_its_swing_lost_its_grip() -> None:
    plan = climbing_plan(limbs_to_move=(0,))
    air = [k for k, knot in enumerate(plan.knots) if knot.limbs[0].phase]
    truth = swing_truth(plan, plan.knots[air[0]].time_s, plan.knots[air[-1] + 1].time_s)
    again = round((plan.knots[air[-1] + 1].time_s + 1.5) / (PERIOD * CYCLE_S))
    truth.pad_face[again : again + 30, 1] = -1
    assert list(verdict_on(truth, plan).lost_grips) == ["LF"]


@pytest.mark.parametrize(("way", "lost"), [(-1, False), (1, True)])
def test_a_limb_that_goes_back_to_its_old_hold_in_reverse_has_lost_no_grip(way: int, lost: bool) -> None:
    plan = climbing_plan(limbs_to_move=(0,))
    air = [k for k, knot in enumerate(plan.knots) if knot.limbs[0].phase]
    lets_go_s, lands_s = plan.knots[air[0]].time_s, plan.knots[air[-1] + 1].time_s - 0.3
    there = swing_truth(plan, lets_go_s, lands_s)
    n = round((lands_s + 2.0) / (PERIOD * CYCLE_S))  # LF stands on its new hold, and bears
    rows = [*range(n), *reversed(range(n))]
    again = replace(there, **{name: table[rows] for name, table in vars(there).items()})
    climbing = np.where(np.arange(2 * n) < n, 1, way)
    truth = replace(again, cycle=1 + np.arange(2 * n) * PERIOD, climbing=climbing)
    verdict = verdict_on(truth, plan, complete=False)
    assert list(verdict.lost_grips) == ["LF"] * lost


def test_where_the_runtime_stops_climbing_the_plan_waits() -> None:
    plan = climbing_plan(limbs_to_move=(0,))
    truth = make_truth(2000)
    climbing = (truth.cycle < 1000).astype(np.int64)  # 2 s of 20: the body, which the plan would lean 30 mm, stays
    verdict = verdict_on(replace(truth, climbing=climbing), plan, complete=False)
    assert not verdict.fell
    assert not verdict.reached_goal


@pytest.mark.parametrize(
    ("offset_m", "tilt_deg", "reached"),
    [(0.009, 0, True), (0.011, 0, False), (0, 2.9, True), (0, 3.1, False)],
)
def test_the_goal_is_reached_within_its_tolerance_on_truth(offset_m: float, tilt_deg: float, reached: bool) -> None:
    truth = make_truth()
    truth.body_position_m[-1, 1] += offset_m
    half = np.radians(tilt_deg) / 2
    truth.body_quaternion[-1] = [np.cos(half), 0, np.sin(half), 0]
    assert verdict_on(truth).reached_goal is reached


def test_an_unfinished_plan_reached_nothing() -> None:
    assert not verdict_on(make_truth(), complete=False).reached_goal


def test_a_log_without_the_climb_leaves_the_tracking_open_and_one_of_half_of_it_tells_of_that() -> None:
    truth, log = make_truth(), make_log()
    truth.body_position_m[:, 1] += np.linspace(0.0, 0.01, SAMPLES)
    whole, half = tracked(truth, log), tracked(truth, cut(log, slice(0, 50 * PERIOD)))
    assert whole.body_max_m == pytest.approx(0.01)
    assert half.body_max_m == pytest.approx(0.01 * 49 / 99)
    log.state["supervisor_state"] = 1
    assert tracked(truth, log) == Tracking(None, None, None, None)


def test_force_error_is_measured_in_the_wall_frame_without_the_hands_weight() -> None:
    turn = rotation_from_rpy([0.1, -0.2, 0.7])
    truth = make_truth()
    truth.gripper_rotation[:] = turn
    truth.hand_wrench_g[:, :, :3] = truth.hand_wrench_g[:, :, :3] @ turn  # the same world force seen from turned hands
    assert tracked(truth).force_rms_n == pytest.approx(0.0, abs=1e-9)
    truth.hand_wrench_g[:, 1, :3] += np.array([2.0, 0, 0]) @ turn
    assert tracked(truth).force_rms_n == pytest.approx(1.0)  # one limb of four off by 2 N


def test_limbs_are_compared_in_the_cycles_they_were_logged_in() -> None:
    truth = make_truth()
    truth.gripper_position_m[1::2] += 0.05  # between two logged cycles the reference is not known
    assert tracked(truth).finger_max_m == 0.0
    truth.gripper_position_m[2, 1, 2] += 0.004
    assert tracked(truth).finger_max_m == pytest.approx(0.004)


def test_before_the_start_nothing_counts() -> None:
    truth, log = make_truth(), make_log()
    log.state["supervisor_state"][: 60 * PERIOD] = 1
    truth.climbing[:60] = False
    truth.body_position_m[:50, 2] -= 0.2
    truth.pad_face[:50] = -1
    before = replace(truth, pad_force_n=np.where(truth.pad_face < 0, 0.0, 20.0))
    assert (verdict_on(before).fell, verdict_on(before).lost_grips) == (False, {})
    assert tracked(before, log).body_max_m == 0.0


@given(st.lists(st.booleans(), max_size=40), st.integers(1, 6))
def test_long_runs_against_splitting_a_string(flags: list[bool], least: int) -> None:
    text = "".join("x" if flag else " " for flag in flags)
    wanted = re.sub("x+", lambda run: run[0] if len(run[0]) >= least else " " * len(run[0]), text)
    assert "".join("x" if flag else " " for flag in long_runs(np.array(flags, dtype=bool), least)) == wanted
