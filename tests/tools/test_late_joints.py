"""Climbs of robots whose drives answer late, and of one that loses two holds at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.robot import load_robot
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.world_file import parse_world, read_world
from crux_tools.paths import WORLDS
from crux_tools.telemetry.channels import read_channels
from hand_plan import climbing_plan

CLIMBING = 2  # robot_state_t


def climbed(world: Path | str, folder: Path) -> tuple[ClimbResult, list[tuple[str, int, float]], bool]:
    """The result, name, limb and value of each fault that was told, and whether the runtime climbed at all."""
    plan = climbing_plan(limbs_to_move=(0,))
    spec = read_world(world) if isinstance(world, Path) else parse_world(f"version: 1\nname: test\n{world}".encode())
    result = climb(plan, load_robot("scaler"), folder / "log.mcap", ClimbOptions(world=spec.draw(0, plan)))
    tables = read_channels(folder / "log.mcap").tables
    faults = [(FAULT_BY_CODE[int(row["code"])].name, int(row["limb"]), float(row["value"])) for row in tables["/fault"]]
    return result, faults, bool((tables["/robot_state"]["supervisor_state"] == CLIMBING).any())


def test_drives_that_answer_four_milliseconds_late_climb(tmp_path: Path) -> None:
    result, faults, _ = climbed(WORLDS / "late-joints-4ms.yaml", tmp_path)
    assert result.ok, result.reason
    assert faults == []


@pytest.mark.parametrize("late_ms", [8, pytest.param(16, marks=pytest.mark.sweep)])
def test_drives_that_answer_later_than_the_gains_bear_do_not_start(late_ms: int, tmp_path: Path) -> None:
    _, faults, climbs = climbed(WORLDS / f"late-joints-{late_ms}ms.yaml", tmp_path)
    assert not climbs
    name, limb, value = faults[0]
    assert name == "joint_late"
    assert limb >= 0
    assert value == pytest.approx(late_ms * 1e-3)


def test_of_two_holds_that_break_at_once_both_are_told(tmp_path: Path) -> None:
    _, faults, _ = climbed("holds: {h0: {breaks_at_s: 4.0}, h3: {breaks_at_s: 4.0}}\n", tmp_path)
    assert {limb for name, limb, _ in faults if name == "grip_lost"} >= {0, 3}
