"""The judge on made-up runs whose slips, falls and errors are known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_tools.bench.judge import Verdict, judge, longest_run, pad_travel
from crux_tools.bench.recorder import Truth
from crux_tools.bench.robot_model import build_model
from crux_tools.bench.start_pose import rotation_from_rpy
from hand_plan import BODY_HEIGHT_M, NOMINAL_M, PAD_HEIGHT_M, Wall, standing_plan
from hypothesis import given
from hypothesis import strategies as st

SAMPLES = 100
PERIOD = 5
PLAN = standing_plan(Wall())
MODEL = build_model(load_robot("scaler"), PLAN)
GRIPPERS = np.column_stack([NOMINAL_M, np.full(4, PAD_HEIGHT_M)])
FACE = [next(i for i, face in enumerate(MODEL.faces) if face.hold == hold) for hold in range(4)]
WEIGHT_N = 3.0
FLAGS = ("supervisor_state", "plan_complete")


def make_truth() -> Truth:
    """Everything in its place, every pad pressing with 20 N."""
    pads = np.repeat(GRIPPERS, 2, axis=0) + np.tile([[0.042, 0, 0], [-0.042, 0, 0]], (4, 1))
    hand_mass = MODEL.model.body_subtreemass[MODEL.gripper_bodies]
    wrench = np.zeros((SAMPLES, 4, 6))
    wrench[:, :, :3] = np.array([0, 0, WEIGHT_N]) + hand_mass[:, None] * np.array(PLAN.gravity_w_m_s2)
    return Truth(
        cycle=1 + np.arange(SAMPLES) * PERIOD,
        body_position_m=np.tile([0, 0, BODY_HEIGHT_M], (SAMPLES, 1)),
        body_quaternion=np.tile([1.0, 0, 0, 0], (SAMPLES, 1)),
        gripper_position_m=np.tile(GRIPPERS, (SAMPLES, 1, 1)),
        gripper_rotation=np.tile(np.eye(3), (SAMPLES, 4, 1, 1)),
        pad_position_m=np.tile(pads, (SAMPLES, 1, 1)),
        pad_force_n=np.full((SAMPLES, 8), 20.0),
        pad_face=np.tile(np.repeat(FACE, 2), (SAMPLES, 1)),
        hand_wrench_g=wrench,
        link_contact_force_n=np.zeros(SAMPLES),
    )


def make_log() -> Any:
    """The runtime climbs from cycle 0 on, all limbs in stance, and finishes."""
    cycles = SAMPLES * PERIOD
    state = np.zeros(
        cycles,
        dtype=[("cycle", "i8"), ("time_s", "f8"), ("plan_time_s", "f8"), *((n, "i1") for n in FLAGS)],
    )
    state["cycle"] = 1 + np.arange(cycles)
    state["time_s"] = state["plan_time_s"] = state["cycle"] * 0.002
    state["supervisor_state"] = 2
    state["plan_complete"][-50:] = 1
    references = np.zeros((cycles, 4), dtype=[("phase", "i1"), ("load", "f8"), ("gripper_position_w_m", "f8", 3)])
    references["load"] = 1.0
    references["gripper_position_w_m"] = GRIPPERS
    limbs = np.zeros((cycles, 4), dtype=[("force_reference_w_n", "f8", 3)])
    limbs["force_reference_w_n"] = [0, 0, WEIGHT_N]
    fresh = np.arange(cycles) % (2 * PERIOD) == 0
    return SimpleNamespace(state=state, references=references, limbs=limbs, limbs_fresh=fresh)


def verdict_on(truth: Truth, log: Any = None) -> Verdict:
    return judge(truth, log or make_log(), PLAN, MODEL)


def test_a_perfect_run() -> None:
    verdict = verdict_on(make_truth())
    assert verdict.reached_goal
    assert not verdict.fell
    assert verdict.slips == 0
    assert verdict.body_max_m == verdict.finger_max_m == verdict.goal_error_m == 0.0
    assert verdict.force_rms_n == pytest.approx(0.0, abs=1e-9)


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
    assert verdict.body_max_m == pytest.approx(0.11)


@pytest.mark.parametrize(("samples", "fell"), [(9, False), (12, True)])
def test_a_limb_without_its_hold_in_stance_fell(samples: int, fell: bool) -> None:
    truth = make_truth()
    truth.pad_face[50 : 50 + samples, 6] = -1
    verdict = verdict_on(truth)
    assert verdict.fell is fell
    assert ("RR lost its hold" in verdict.fall_reason) is fell


def test_the_same_limb_in_the_air_did_not_fall() -> None:
    truth, log = make_truth(), make_log()
    truth.pad_face[50:80, 6:] = -1
    log.references["phase"][:, 3] = 4
    assert not verdict_on(truth, log).fell


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
    log = make_log()
    log.state["plan_complete"] = 0
    assert not verdict_on(make_truth(), log).reached_goal


def test_force_error_is_measured_in_the_wall_frame_without_the_hands_weight() -> None:
    turn = rotation_from_rpy([0.1, -0.2, 0.7])
    truth = make_truth()
    truth.gripper_rotation[:] = turn
    truth.hand_wrench_g[:, :, :3] = truth.hand_wrench_g[:, :, :3] @ turn  # the same world force seen from turned hands
    assert verdict_on(truth).force_rms_n == pytest.approx(0.0, abs=1e-9)
    truth.hand_wrench_g[:, 1, :3] += np.array([2.0, 0, 0]) @ turn
    assert verdict_on(truth).force_rms_n == pytest.approx(1.0)  # one limb of four off by 2 N


def test_limbs_are_compared_in_the_cycles_they_were_logged_in() -> None:
    truth = make_truth()
    truth.gripper_position_m[1::2] += 0.05  # between two logged cycles the reference is not known
    assert verdict_on(truth).finger_max_m == 0.0
    truth.gripper_position_m[2, 1, 2] += 0.004
    assert verdict_on(truth).finger_max_m == pytest.approx(0.004)


def test_before_the_start_nothing_counts() -> None:
    truth, log = make_truth(), make_log()
    log.state["supervisor_state"][: 60 * PERIOD] = 1
    truth.body_position_m[:50, 2] -= 0.2
    truth.pad_face[:50] = -1
    verdict = verdict_on(replace(truth, pad_force_n=np.where(truth.pad_face < 0, 0.0, 20.0)), log)
    assert not verdict.fell
    assert verdict.body_max_m == 0.0


@given(st.lists(st.booleans(), max_size=40))
def test_longest_run_against_splitting_a_string(flags: list[bool]) -> None:
    text = "".join("x" if flag else " " for flag in flags)
    assert longest_run(np.array(flags, dtype=bool)) == max(map(len, text.split()), default=0)
