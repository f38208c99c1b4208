"""The admittance's calibration in climbs: its worth, that its log tells of it, and that a replay computes it again."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from crux_contracts.robot import Robot, load_robot
from crux_msgs import plan_t
from crux_simulation.benchmarks.figure9 import (
    BETTER,
    NO_WORSE,
    Climb,
    climb_with,
    verdicts,
    wrench_rms,
    write_robot_with,
)
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry import read_log
from hand_plan import BODY_HEIGHT_M, Wall, climbing_plan, finish, standing_plan

DAMPING, WRONG = 1, 4.0
PRESS_N, PRESS_KNOTS = 24.0, 5


def pressing_plan() -> plan_t:
    """The robot hangs still on four holds and presses LF and RF apart and together, along the line between them."""
    wall, body_m = Wall(dt_s=1.0), np.tile([0.0, 0.0, BODY_HEIGHT_M], (PRESS_KNOTS, 1))
    plan = standing_plan(wall, body_m)
    for k, knot in enumerate(plan.knots):
        for limb, sign in ((0, 1.0), (1, -1.0)):
            forces_N = np.array(knot.limbs[limb].finger_force_w_n)
            forces_N[[1, 4]] += 0.5 * sign * PRESS_N * math.sin(0.5 * math.pi * k)
            knot.limbs[limb].finger_force_w_n = forces_N.tolist()
    return finish(wall, plan.knots)


def robot_without_bias(folder: Path) -> Robot:
    """Its sensors' bias is an error of the wrenches' sum that no gains lessen, larger than what these make of it."""
    write_robot_with(load_robot("scaler"), 1.0, folder)
    text = yaml.safe_load((folder / "robot.yaml").read_text(encoding="utf-8"))
    text["force_torque"] |= {"bias_N": 0.0, "bias_Nm": 0.0}
    (folder / "robot.yaml").write_text(yaml.safe_dump(text), encoding="utf-8")
    return load_robot(folder)


@pytest.fixture(scope="module")
def climbs(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[float, bool], tuple[Climb, Path]]:
    """That plan on holds that give, by factor on the gains and whether they are calibrated."""
    folder = tmp_path_factory.mktemp("calibration")
    plan, base, made = pressing_plan(), robot_without_bias(folder / "base"), {}
    for factor in (1.0, WRONG):
        robot = folder / f"{factor:g}"
        write_robot_with(base, factor, robot)
        for calibrated in (False, True):
            log = folder / f"{factor:g}-{calibrated}.mcap"
            made[factor, calibrated] = climb_with(plan, robot, Climb(2e4, factor, calibrated), log), log
    return made


@pytest.mark.parametrize(("factor", "most"), [(1.0, NO_WORSE), (WRONG, BETTER)])
def test_calibration_mends_wrong_gains_and_spoils_no_right_ones(
    climbs: dict[tuple[float, bool], tuple[Climb, Path]], factor: float, most: float
) -> None:
    assert climbs[factor, True][0].wrench_N < most * climbs[factor, False][0].wrench_N


def test_the_log_has_the_gains(climbs: dict[tuple[float, bool], tuple[Climb, Path]]) -> None:
    loaded = WRONG * load_robot("scaler").admittance.damping_Ns_m
    fixed, calibrated = (
        read_log(climbs[WRONG, how][1]).limbs["admittance_gains"][:, :, DAMPING] for how in (False, True)
    )
    assert np.all(fixed == loaded)
    np.testing.assert_allclose(calibrated[0], loaded)
    assert np.all(calibrated[-1] < 0.7 * loaded)


@pytest.mark.parametrize("calibrated", [False, True])
def test_a_replay_computes_it_again_to_the_bit(
    climbs: dict[tuple[float, bool], tuple[Climb, Path]], calibrated: bool
) -> None:
    assert recompute(climbs[WRONG, calibrated][1]).ok


def test_gains_four_times_too_small_are_refused_with_those_that_hold(tmp_path: Path) -> None:
    write_robot_with(load_robot("scaler"), 1.0 / WRONG, tmp_path / "robot")
    climb = climb_with(climbing_plan(), tmp_path / "robot", Climb(math.inf, 1.0 / WRONG, False), tmp_path / "log.mcap")
    assert "damping_Ns_m: 100: expected at least 287.3: stable against 2 times environment_N_m" in climb.refused


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
    def climb(factor: float, calibrated: bool, wrench_N: float, seed: int = 0) -> Climb:
        return Climb(2e4, factor, calibrated, seed, wrench_N=wrench_N)

    climbs = [
        *(climb(1.0, False, 0.6), climb(1.0, False, math.sqrt(2.0 - 0.36), seed=1), climb(1.0, True, 1.1)),
        *(climb(4.0, False, 2.0), climb(4.0, True, 1.3)),
        *(Climb(2e4, 0.25, how, refused="too small") for how in (False, True)),
    ]
    lines = verdicts(climbs)
    assert [(line["factor"], line["ok"]) for line in lines] == [(1.0, False), (4.0, True)]
    assert [line["ratio"] for line in lines] == pytest.approx([1.1, 0.65])
    assert [line["right"] for line in lines] == pytest.approx([1.0, 0.5])
