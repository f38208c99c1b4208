"""`crux bench guide`: what is drawn, and how ends are counted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_simulation.benchmarks.guided_climbs import KINDS, drawn, jobs_of, line_of, mishaps, stands_s
from crux_simulation.benchmarks.random_walls import random_ladder
from crux_simulation.benchmarks.worlds import SCENES as SHIPPED
from crux_simulation.campaign.job import WorldFile
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_tools.telemetry import read_channels
from shared_plans import SharedPlans, unproven
from short_climb import with_a_spare_hold

SCENES = Path(__file__).parents[2] / "msgs" / "scenarios"


@pytest.fixture(scope="module")
def plan(planned: SharedPlans) -> Any:
    return planned(load_scenario(SCENES / "climb-four-holds.yaml"), load_robot("scaler")).plan


@pytest.mark.usefixtures("briefly_watched")
def test_a_hold_breaks_under_a_limb_while_all_limbs_hold(planned: SharedPlans, tmp_path: Path) -> None:
    plan = planned(with_a_spare_hold(), load_robot("scaler")).plan
    earliest = 0, len(plan.knots)
    for seed in range(20):
        mishap = drawn("hold-breaks", seed, plan)
        assert mishap is not None
        earliest = min(earliest, (seed, mishap.knot), key=lambda drawn: drawn[1])
        knot = plan.knots[mishap.knot]
        assert min(limb.hold for limb in knot.limbs) >= 0
        assert knot.limbs[mishap.limb].hold == mishap.hold
        assert mishap.entry("hold-breaks", 9.5) == f"holds: {{{mishap.hold}: {{breaks_at_s: 9.500}}}}"
    seed, _ = earliest
    mishap = drawn("hold-breaks", seed, plan)
    assert mishap is not None
    at_s = stands_s(plan, mishap.knot, seed)
    world = WorldFile("x", f"version: 1\nname: x\n{mishap.entry('hold-breaks', at_s)}\n").draw(seed, plan)
    climb(plan, load_robot("scaler"), tmp_path / "log.mcap", ClimbOptions(seed=seed, world=world))
    contacts = read_channels(tmp_path / "log.mcap").tables["/truth/contacts"]
    pressed = contacts["pad_normal_force_n"].reshape(-1, 4, 2).min(axis=2) > 0.0
    before, after = (np.searchsorted(contacts["cycle"], (at_s + late_s) / 0.002) for late_s in (-0.01, 0.05))
    assert pressed[before].all(), "all limbs gripped"
    assert pressed[after].tolist() == [limb != mishap.limb for limb in range(4)]


def test_holds_that_are_elsewhere_or_smooth_are_not_those_of_the_start(plan: Any) -> None:
    start = {limb.hold for limb in plan.knots[0].limbs}
    assert {mishap.hold for mishap in mishaps(plan, breaks=False)}.isdisjoint(start)
    assert start <= {mishap.hold for mishap in mishaps(plan, breaks=True)}


def test_a_hold_that_the_goal_asks_for_has_no_other(plan: Any) -> None:
    asked = {grasp["hold"] for grasp in yaml.safe_load(plan.scenario_yaml)["goal"]["grasps"].values()}
    assert asked
    for mishap in mishaps(plan, breaks=True):
        assert not (mishap.has_other and plan.holds[mishap.hold].name in asked)


def test_every_kind_is_a_world_of_its_own(plan: Any) -> None:
    jobs = jobs_of(list(KINDS), 2, 7)
    seeds = range(7, 7 + 2 + len(SHIPPED))
    assert [(job.walls, job.seed) for job in jobs] == [(kind, seed) for kind in KINDS for seed in seeds]
    for job in jobs:
        mishap = drawn(job.walls, job.seed, plan)
        assert mishap is not None
        world = WorldFile(job.walls, f"version: 1\nname: x\n{mishap.entry(job.walls, 9.5)}\n").draw(job.seed, plan)
        assert [sensor.on in LIMB_NAMES for sensor in world.sensors] == [True] * (job.walls == "ft-lost")
        assert job.climb_command().endswith("--guide")


def test_ends_are_counted_by_whether_there_was_another_hold() -> None:
    def row(
        ok: bool, has_other: bool, fell: bool = False, stood_s: tuple[float, ...] = (), slips: int = 0
    ) -> dict[str, Any]:
        climb = {"ok": ok and not slips, "reached_goal": ok, "fell": fell, "slips": slips, "has_other": has_other}
        guide = {"plans": len(stood_s), "stood_s": list(stood_s)}
        return {"climb": {**climb, "guide": guide}}

    rows = [row(True, True, stood_s=(1.0, 4.0)), row(False, True, fell=True), row(True, False, slips=6)]
    assert line_of(rows) == {
        "climbs": 3, "at_goal": 2, "with_another_hold": 2, "of_these_at_goal": 1, "slipped": 1, "replanned": 1,
        "fell": 1, "stood_s": {"median": 2.5, "most": 4.0},
    }  # fmt: skip


def test_every_hold_of_a_drawn_ladder_has_another_beside_it_that_the_goal_does_not_ask_for() -> None:
    jobs = jobs_of(["hold-breaks"], 8, 7)
    assert [yaml.safe_load(job.wall.text)["name"] for job in jobs[8:]] == list(SHIPPED)
    for job in jobs[:8]:
        content = yaml.safe_load(job.wall.scenario())
        places = {hold["name"]: np.array(hold["position_m"]) for hold in content["holds"]}
        assert "grasps" not in content["goal"]
        for name, place in places.items():
            others = [float(np.linalg.norm(place - other)) for key, other in places.items() if key != name]
            assert 0.12 - 1e-4 <= min(others) <= 0.15 + 1e-4
            if not name.startswith("spare-"):
                assert 0.125 - 1e-4 <= np.linalg.norm(place - places[f"spare-{name}"]) <= 0.15 + 1e-4
    plain, spared = yaml.safe_load(random_ladder(7, 5)), yaml.safe_load(random_ladder(7, 5, spares=True))
    assert spared["holds"][: len(plain["holds"])] == plain["holds"]


@pytest.mark.sweep
def test_the_map_is_not_turned_by_the_forces_of_a_limb_whose_sensor_is_dead(tmp_path: Path) -> None:
    wall = random_ladder(7105, rungs=5, spares=True)
    plan = unproven(parse_scenario(wall), load_robot("scaler")).plan
    dead = "sensors: [{sensor: force_torque, on: LR, error: zero, from_s: 39.262}]"
    world = WorldFile("x", f"version: 1\nname: x\n{dead}\n").draw(7105, plan)
    log = tmp_path / "log.mcap"
    climbed = climb(plan, load_robot("scaler"), log, ClimbOptions(seed=7105, world=world, guide=True))
    assert climbed.as_json()["guide"]["plans"] == 1
    state, truth = (read_channels(log).tables[topic] for topic in ("/robot_state", "/truth/body"))
    true_m = truth["position_w_m"][np.searchsorted(truth["cycle"], state["cycle"][-1]) - 1]
    assert np.linalg.norm(state["body_position_w_m"][-1] - true_m) < 0.003
