"""Slips in physics: when the runtime says so, and what becomes of the robot."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.world_file import parse_world
from crux_tools.telemetry.channels import Channels, read_channels
from hand_plan import climbing_plan

pytestmark = pytest.mark.usefixtures("briefly_watched")
SLIP = 6  # robot_state_t.waiting_for
CLOSE = 6  # LimbPhase
GRASP_FAILED, SLID = 21, 22  # msgs/faults.yaml
RF = 1
LANDED, PUSHED = 13, 16  # knots
SMOOTH = "holds: {h1: {friction_factor: 0.11}}\n"  # the hold that RF begins on: no pull has tested its grasp
ORDINARY = """
robot: {joints: {all: {backlash_rad: {uniform: [0, 0.010]}}}}
sensors:
  - {sensor: encoder, on: all, error: bias, rad: {uniform: [-0.010, 0.010]}}
  - {sensor: force_torque, on: all, error: bias, N: {uniform: [-2, 2]}, Nm: {uniform: [-0.06, 0.06]}}
pushes: [{at_s: 12, for_s: 1, force_N: [0, 30, 0]}]
"""


@cache
def climbed(
    text: str, seed: int = 0, slope_deg: float = 70, dt_s: float = 1.0, until: int | None = LANDED
) -> tuple[ClimbResult, Channels]:
    """Both front limbs climb a wall, a steep one, in a world, until LF has landed or so many knots."""
    plan = climbing_plan(slope_deg=slope_deg, limbs_to_move=(0, RF), dt_s=dt_s, until=until)
    world = parse_world(f"version: 1\nname: test\n{text}".encode()).draw(seed, plan)
    with TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        result = climb(plan, load_robot("scaler"), log, ClimbOptions(seed=seed, world=world))
        return result, read_channels(log)


def slid_m(log: Channels) -> tuple[np.ndarray, np.ndarray]:
    """Cycles (n,) and how far (n,) RF's pads really are from where they were in READY."""
    truth = log.tables["/truth/contacts"]
    pads = truth["pad_position_w_m"].reshape(-1, 4, 2, 3)[:, RF].astype(float)
    return truth["cycle"], np.linalg.norm(pads - pads[100], axis=-1).max(axis=1)


def test_a_slip_is_felt_within_50_ms_and_3_mm_and_the_plan_waits_until_it_is_over() -> None:
    result, log = climbed(SMOOTH, dt_s=2.0)
    state = log.tables["/robot_state"]
    waits = state["waiting_for"] == SLIP
    felt = int(state["cycle"][np.argmax(waits)])
    assert waits.any()
    assert set(state["waiting_limb"][waits]) == {RF}
    cycles, way = slid_m(log)
    at = np.searchsorted(cycles, felt)
    assert way[at] < 0.003
    assert way[np.searchsorted(cycles, felt - 25)] < 0.001  # 50 ms before it had hardly begun
    assert np.ptp(state["plan_time_s"][waits]) < 0.003  # the clock stands
    assert not waits[-1]
    assert not result.verdict.fell, result.reason
    squeeze = log.tables["/limb_telemetry"]
    squeeze = squeeze[squeeze["limb"] == RF]["grasp_force_reference_n"]
    assert squeeze.max() > 55
    (friction,) = set(log.tables["/limb_reference"]["friction"][:4]) - {0.0}
    grasp = log.tables["/limb_telemetry"]
    slipped_at = grasp[grasp["limb"] == RF]["slip_friction"]
    assert slipped_at.max() == pytest.approx(0.11 * friction, rel=0.25)  # what its hold really has
    assert not grasp[grasp["limb"] != RF]["slip_friction"].any()


def test_a_grasp_that_has_slipped_is_loaded_no_more_than_its_friction_bears_and_the_climb_goes_on() -> None:
    result, log = climbed(SMOOTH.replace("0.11", "0.09"))
    assert result.ok, result.reason
    waits = log.tables["/robot_state"]["waiting_for"] == SLIP
    assert np.count_nonzero(np.diff(waits.astype(int)) == 1) == 1  # it does not slip again


@pytest.mark.parametrize("friction_factor", [0.03, pytest.param(0.07, marks=pytest.mark.sweep)])
def test_a_grip_that_the_plan_begins_with_and_that_slides_too_far_is_told(friction_factor: float) -> None:
    """Before the plan's clock starts, or little by little after it."""
    result, log = climbed(SMOOTH.replace("0.11", str(friction_factor)), dt_s=2.0)
    fault = log.tables["/fault"][0]  # what this does to the robot is told beside it
    assert (fault["code"], fault["limb"]) == (SLID, RF), result.reason
    assert not result.verdict.fell, result.reason


@pytest.mark.parametrize(("seed", "until"), [(1, PUSHED), pytest.param(2, None, marks=pytest.mark.sweep)])
def test_play_wrong_encoders_and_a_push_are_no_slip(seed: int, until: int | None) -> None:
    _, log = climbed(ORDINARY, seed, until=until)
    assert not (log.tables["/robot_state"]["waiting_for"] == SLIP).any()
    assert not len(log.tables.get("/fault", ()))


def test_a_grasp_that_gives_way_when_it_is_pulled_is_made_anew_on_both_sides_and_then_told() -> None:
    result, log = climbed("holds: {h4: {friction_factor: 0.03}}\n", slope_deg=45, until=None)
    (fault,) = log.tables["/fault"]
    assert fault["code"] == GRASP_FAILED
    assert not result.verdict.fell, result.reason
    limb = int(fault["limb"])
    reference = log.tables["/limb_reference"]
    closes = reference["phase"][reference["limb"] == limb] == CLOSE
    assert np.count_nonzero(np.diff(closes.astype(int)) == 1) == 3
    truth = log.tables["/truth/contacts"]
    widest = np.linalg.norm(np.diff(truth["pad_position_w_m"].reshape(-1, 4, 2, 3)[:, limb], axis=1)[:, 0], axis=-1)
    pads_on = (truth["pad_hold"].reshape(-1, 4, 2)[:, limb] >= 0).all(axis=1)
    assert widest[~pads_on].max() > widest[pads_on].max() + 0.01  # fingers did open between the tries
