"""A climb in which nodes of one limb run their images on emulated microcontrollers, beside the same climb with the
host's library alone: a whole one, or one in which the body alone moves."""

from __future__ import annotations

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from climbs import climb_here
from crux_contracts.plan_file import write_plan
from crux_tools.telemetry.reader import Telemetry, read_log
from crux_tools.telemetry.summary import PHASE_NAMES
from hand_plan import BODY_HEIGHT_M, Wall, standing_plan
from short_climb import plan_short_climb
from with_can import CRUX

JOINT_AND_GRIPPER, ALL_NODES = "LF.2,LF.7", "LF"
SWEPT = pytest.mark.sweep
CLIMBS = (
    (False, JOINT_AND_GRIPPER),
    pytest.param((True, JOINT_AND_GRIPPER), marks=SWEPT),
    pytest.param((True, ALL_NODES), marks=SWEPT),
)  # whether LF takes a step, and what of it is emulated
BODY_M = [[x, 0.0, BODY_HEIGHT_M] for x in (0.0, 0.01, 0.02, 0.02)]
LF = slice(0, 6)
CLOSE, LOAD = PHASE_NAMES.index("close"), PHASE_NAMES.index("load")


@dataclass
class Climb:
    status: int
    result: dict[str, Any]
    log: Telemetry


def _climb(plan: Path, name: str, *options: str) -> Climb:
    log = plan.with_name(f"{name}.mcap")
    done = subprocess.run(
        [*CRUX, "climb", str(plan), "-o", str(log), "--json", *options], capture_output=True, text=True, check=False
    )
    assert done.stdout, done.stderr
    return Climb(done.returncode, json.loads(done.stdout), read_log(log))


def _force_error_N(log: Telemetry, phases: tuple[int, ...]) -> float:
    """Root mean square over LF's cycles in `phases`."""
    of = np.isin(log.references["phase"][:, 0], phases)
    error = (log.limbs["force_w_n"] - log.limbs["force_reference_w_n"])[of, 0]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


@pytest.fixture(scope="module", params=CLIMBS, ids=lambda param: f"{'step' if param[0] else 'body'}-{param[1]}")
def climbs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Climb, Climb]:
    """With the library alone, and with emulated boards."""
    (step, nodes), folder = request.param, tmp_path_factory.mktemp("emulated")
    plan = plan_short_climb(folder) if step else folder / "plan.mcap"
    if not step:
        write_plan(plan, standing_plan(Wall(dt_s=1.0), np.array(BODY_M)))
    with ThreadPoolExecutor(1) as pool:
        emulated = pool.submit(_climb, plan, "emulated", "--emulate", nodes)
        log = folder / "library.mcap"
        status, result = climb_here(plan, log)
        return Climb(status, result, read_log(log)), emulated.result()


def test_reaches_the_goal_as_with_the_library(climbs: tuple[Climb, Climb]) -> None:
    library, emulated = climbs
    assert emulated.status == 0, emulated.result
    assert emulated.result["ok"]
    assert emulated.result["slips"] == 0
    assert emulated.result["missed_cycles"] == 0
    assert emulated.result["goal_error"]["m"] == pytest.approx(library.result["goal_error"]["m"], abs=1e-3)
    assert emulated.result["tracking"]["body_m"] == pytest.approx(library.result["tracking"]["body_m"], abs=1e-3)


def test_bears_its_load_as_with_the_library(climbs: tuple[Climb, Climb]) -> None:
    # With real current loops the body swings by some 5 N across a grasp that is pulled, at 0.8 Hz: 2.8 N rms.
    lets_go = (climbs[0].log.references["phase"][:, 0] == CLOSE).any()
    for phases, bound_N in (((0, 1, 2, 3, 4, 5), 0.3), *[((CLOSE, LOAD), 4.0)] * int(lets_go)):
        one, two = (_force_error_N(climb.log, phases) for climb in climbs)
        assert two < one + bound_N, phases


def test_ends_in_the_same_posture_under_the_same_torques(climbs: tuple[Climb, Climb]) -> None:
    # Not compared cycle by cycle: a real gripper takes longer to let go and to grip, and the plan's clock waits for it.
    for field, bound in (("joint_position_rad", 0.01), ("joint_torque_nm", 0.5)):
        one, two = (climb.log.inputs[field][-100:, LF].mean(axis=0) for climb in climbs)
        assert np.all(np.abs(one - two) < bound), (field, one - two)


def test_interrupts_stay_about_what_the_bench_counts_at_the_worst(climbs: tuple[Climb, Climb]) -> None:
    _, emulated = climbs
    worst = emulated.result["worst_interrupts"]
    assert 1000 < worst["current_loop"] < 1350  # instructions; `crux bench firmware` counts their cycles
    assert 100 < worst["can"] < 700


def test_the_images_have_really_run(climbs: tuple[Climb, Climb]) -> None:
    library, emulated = climbs
    cycles = min(len(library.log.inputs), len(emulated.log.inputs))
    one, two = (climb.log.inputs["joint_position_rad"][1000:cycles, LF] for climb in climbs)
    assert not np.array_equal(one, two)
