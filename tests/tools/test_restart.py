"""The runtime dies with its robot on the wall and comes up again: it finds the robot, holds it and climbs on. Needs the
build."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_msgs import limb_knot_t, plan_t
from crux_simulation.sim.restarting import HOLDING, Restarting
from crux_tools.operator_status import status_lines
from crux_tools.replay.recompute import recompute
from shared_plans import SharedPlans
from short_climb import with_a_spare_hold

SCENES = Path(__file__).parents[2] / "msgs" / "scenarios"
MOMENTS = 50


@pytest.fixture(scope="module")
def plan(planned: SharedPlans) -> plan_t:
    """The wall of four holds a side."""
    made: plan_t = planned(load_scenario(SCENES / "climb-four-holds.yaml"), load_robot("scaler")).plan
    return made


def restarting(plan: plan_t, folder: Path, seed: int = 0) -> Restarting:
    return Restarting(plan, load_robot("scaler"), folder, folder / "state", seed)


def in_the_air_s(plan: plan_t) -> list[float]:
    """The middles of the intervals in which a limb is in the air."""
    times = [knot.time_s for knot in plan.knots if any(limb.phase == limb_knot_t.AIR for limb in knot.limbs)]
    return [time_s + plan.dt_s / 2 for time_s in times if time_s < plan.knots[-1].time_s]


def test_a_runtime_finds_its_robot_with_a_limb_in_the_air(planned: SharedPlans, tmp_path: Path) -> None:
    plan: plan_t = planned(with_a_spare_hold(), load_robot("scaler")).plan
    when_s = in_the_air_s(plan)[1]
    with restarting(plan, tmp_path) as climb:
        before = climb.climb_until(when_s)
        (flying,) = [limb for limb in range(4) if before.reference[limb].phase not in (0, 1, 7)]
        found = climb.restart(down_cycles=500)
        assert FAULT_BY_CODE[found.fault.code].name == "restarted"
        assert found.state.supervisor_state == HOLDING
        assert found.state.fault_code == 0
        assert found.state.plan_time_s == pytest.approx(before.state.plan_time_s, abs=0.2)
        assert found.reference[flying].phase not in (0, 1, 7)
        name = ("LF", "RF", "LR", "RR")[flying]
        others = " ".join(limb for limb in ("LF", "RF", "LR", "RR") if limb != name)
        (told,) = [line for line in status_lines(found) if "found hanging" in line]
        assert f"on {others}, {name} in the air at (" in told
        body_m = np.array(found.state.body_position_w_m)
        true_m = climb.plant.data.qpos[:3].copy()
        assert np.linalg.norm(body_m - true_m) < 0.02
        said = climb.guide()
        assert any("has restarted" in line for line in said), said
        verdict = climb.verdict()
        logs = climb.logs
    assert verdict.reached_goal, (said, verdict)
    assert not verdict.fell
    assert not verdict.lost_grips
    again = recompute(logs[-1])
    assert again.ok, again.first_difference


@pytest.mark.sweep
@pytest.mark.parametrize("moment", range(MOMENTS))
def test_any_moment_is_gone_on_from(plan: plan_t, tmp_path: Path, moment: int) -> None:
    """Half of them with a limb in the air."""
    random = np.random.default_rng(moment)
    when_s = float(random.uniform(0.1, plan.knots[-1].time_s - 0.1))
    if moment % 2:
        when_s = float(random.choice(in_the_air_s(plan)) + random.uniform(-0.5, 0.5) * plan.dt_s)
    with restarting(plan, tmp_path, seed=moment) as climb:
        climb.climb_until(when_s)
        climb.restart(down_cycles=int(random.integers(1, 1500)))
        said = climb.guide()
        verdict = climb.verdict()
    assert verdict.reached_goal, (when_s, said, verdict)
    assert not verdict.fell
    assert not verdict.lost_grips
