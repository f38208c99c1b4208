"""A robot whose nodes lose their power: it hangs by its screws, stands up again by itself and goes on."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.fault_file import Fault
from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.plant import Plant
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry.channels import read_channels
from hand_plan import Wall, climbing_plan, standing_plan
from holding_controller import HoldingController
from shared_plans import SCENES, SharedPlans

SCALER = load_robot("scaler")
BRAKED, FREE, POWERED = 1, 2, 0
POWER_LOST, STAND_UP = 38, 7
FIRST_S, LAST_S = 4.0, 5.0  # of the moments: after the climb's beginning, before its end
SEEDS = {"climb-four-holds": 1, "climb-vertical": 2, "climb-overhang": 3}
MOMENTS = 50


def hanging(supply: int, nodes: FirmwareNodes, seconds: float) -> Plant:
    """A robot under an overhang that has gripped with 30 N, and then been without power."""
    plan = standing_plan(Wall(slope_deg=110.0))
    plant = Plant(build_model(SCALER, plan), plan, 0)
    HoldingController(plant, 30.0).run(1.6)  # the hand has let go
    switch(nodes, supply)
    for _ in range(round(seconds / plant.dt_s)):
        nodes.step(plant)
    return plant


def switch(nodes: FirmwareNodes, supply: int) -> None:
    for limb in range(4):
        for node in range(1, 8):
            nodes.injector.power(limb, node, supply)


def test_without_power_the_robot_hangs_limp_by_its_screws() -> None:
    sunk_m = []
    for supply in (BRAKED, FREE):
        with FirmwareNodes(["memory:"] * 4, SCALER) as nodes:
            plant = hanging(supply, nodes, 0.4)
            sunk_m.append(float(-plant.data.qpos[0]))
            assert plant.limbs_on_holds().all()
            assert np.abs(plant.joint_torque_nm).max() == 0.0
            assert plant.pad_force_n.min() > 15.0, "no finger has moved back"
    braked_m, free_m = sunk_m
    assert 0.003 < braked_m < 0.03
    assert free_m > 0.1


def test_fingers_stand_as_their_node_restarts_and_open_when_told_to() -> None:
    with FirmwareNodes(["memory:"] * 4, SCALER) as nodes:
        plant = hanging(BRAKED, nodes, 0.1)
        gripped_m, squeeze_n = plant.finger_opening_m.copy(), plant.pad_force_n.copy()
        switch(nodes, POWERED)
        for _ in range(100):
            nodes.step(plant)
        np.testing.assert_allclose(plant.finger_opening_m, gripped_m, atol=2e-5)
        assert (plant.pad_force_n > 0.8 * squeeze_n).all()
        for _ in range(50):
            plant.step(np.zeros(24), np.array([-20.0, 0.0, 20.0, 60.0]))
        moved_m = plant.finger_opening_m - gripped_m
        assert moved_m[0] > 1e-3, "told to open"
        assert np.abs(moved_m[1:3]).max() < 2e-5, "as long as the drive presses with less than the screw"
        assert moved_m[3] < 0.0, "and closes further with more"


def lost_power(plan: object, at_s: float, for_s: float, log: Path) -> ClimbResult:
    fault = Fault("power_lost", -1, at_s, for_s)
    return climb(plan, SCALER, log, ClimbOptions(faults=(fault,), resumes=True))  # type: ignore[arg-type]


def test_power_lost_in_mid_swing_is_named_and_the_climb_goes_on(tmp_path: Path) -> None:
    result = lost_power(climbing_plan(limbs_to_move=(0,)), 9.0, 1.0, tmp_path / "log.mcap")
    assert result.verdict.reached_goal, result.reason
    assert not result.verdict.lost_grips
    tables = read_channels(tmp_path / "log.mcap").tables
    faults = tables["/fault"]["code"].tolist()
    assert POWER_LOST in faults
    state = tables["/robot_state"]
    rises = np.flatnonzero(state["waiting_for"] == STAND_UP)
    assert len(rises)
    speed_m_s = np.linalg.norm(np.diff(state["body_reference_position_w_m"][rises], axis=0), axis=1) / np.diff(
        state["time_s"][rises]
    )
    assert speed_m_s.max() < 0.021


@pytest.mark.sweep
@pytest.mark.parametrize("scene", sorted(SEEDS))
def test_power_lost_at_any_moment_loses_no_grip(scene: str, planned: SharedPlans, tmp_path: Path) -> None:
    plan = planned(load_scenario(SCENES / f"{scene}.yaml"), SCALER).plan
    draws = random.Random(SEEDS[scene])
    finished, lost = 0, []
    for _ in range(MOMENTS):
        at_s = round(draws.uniform(FIRST_S, plan.knots[-1].time_s - LAST_S), 2)
        result = lost_power(plan, at_s, 5.0, tmp_path / "log.mcap")
        finished += result.verdict.reached_goal
        lost += [(at_s, limb) for limb in result.verdict.lost_grips]
    assert not lost
    assert finished >= 45
