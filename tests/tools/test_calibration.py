"""The admittance's calibration in climbs: its worth, that its log tells of it, and that a replay computes it again."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_tools.benchmarks.figure9 import Climb, climb_with, robot_with, verdicts, wrench_rms
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry import read_log
from hand_plan import climbing_plan

DAMPING, WRONG = 1, 4.0


@pytest.fixture(scope="module")
def climbs(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, tuple[Climb, Path]]:
    """One limb's climb on holds that give, with gains four times too large; by whether they are calibrated."""
    folder = tmp_path_factory.mktemp("calibration")
    plan, robot = climbing_plan(limbs_to_move=(0,)), robot_with(load_robot("scaler"), WRONG, folder / "robot")
    made = {}
    for calibrated in (False, True):
        log = folder / f"{calibrated}.mcap"
        made[calibrated] = climb_with(plan, robot, Climb(2e4, WRONG, calibrated), log), log
    return made


def test_calibration_lowers_the_wrench_error_of_wrong_gains(climbs: dict[bool, tuple[Climb, Path]]) -> None:
    assert climbs[True][0].wrench_N < climbs[False][0].wrench_N


def test_the_log_has_the_gains(climbs: dict[bool, tuple[Climb, Path]]) -> None:
    loaded = WRONG * load_robot("scaler").admittance.damping_Ns_m
    fixed, calibrated = (read_log(climbs[how][1]).limbs["admittance_gains"][:, :, DAMPING] for how in (False, True))
    assert np.all(fixed == loaded)
    np.testing.assert_allclose(calibrated[0], loaded)
    assert np.all(calibrated[-1] < 0.7 * loaded)


@pytest.mark.parametrize("calibrated", [False, True])
def test_a_replay_computes_it_again_to_the_bit(climbs: dict[bool, tuple[Climb, Path]], calibrated: bool) -> None:
    assert recompute(climbs[calibrated][1]).ok


def test_gains_four_times_too_small_are_refused_with_those_that_hold(tmp_path: Path) -> None:
    robot = robot_with(load_robot("scaler"), 1.0 / WRONG, tmp_path / "robot")
    climb = climb_with(climbing_plan(), robot, Climb(math.inf, 1.0 / WRONG, False), tmp_path / "log.mcap")
    assert "damping_Ns_m is 100; against 2 times environment_N_m" in climb.refused
    assert "it is stable from" in climb.refused


def test_the_rms_is_of_loaded_limbs_alone() -> None:
    loads = np.array([[1.0, 1.0, 0.5, 1.0], [1.0, 1.0, 1.0, 1.0]])
    phases = np.array([[0, 0, 0, 3], [0, 0, 0, 0]])
    error = np.array([[3.0, 1.0, 9.0, 9.0], [9.0, 9.0, 9.0, 9.0]])
    force = np.stack([error, np.zeros_like(error), np.zeros_like(error)], axis=2)
    limbs = {
        "force_w_n": force + 20.0,
        "force_reference_w_n": np.full_like(force, 20.0),
        "moment_w_nm": 0.1 * force,
        "moment_reference_w_nm": np.zeros_like(force),
    }
    state = {"supervisor_state": np.array([2, 1])}
    references = {"phase": phases, "load": loads}
    log = SimpleNamespace(limbs_fresh=np.array([True, True]), state=state, references=references, limbs=limbs)
    assert wrench_rms(log, 0.1) == pytest.approx((math.sqrt(5.0), 0.1 * math.sqrt(5.0), math.sqrt(10.0)))


def test_a_verdict_needs_both_climbs_and_says_where_it_is_missed() -> None:
    def climb(factor: float, calibrated: bool, wrench_N: float) -> Climb:
        return Climb(2e4, factor, calibrated, wrench_N=wrench_N)

    climbs = [
        *(climb(1.0, False, 1.0), climb(1.0, True, 1.1), climb(4.0, False, 2.0), climb(4.0, True, 1.3)),
        *(Climb(2e4, 0.25, how, refused="too small") for how in (False, True)),
    ]
    assert [(line["factor"], line["ok"]) for line in verdicts(climbs)] == [(1.0, False), (4.0, True)]
