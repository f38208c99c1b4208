"""`crux bench uncertainty`: margins against MuJoCo's own contact forces, and what is planned and said."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from crux_contracts.robot import load_robot
from crux_simulation.benchmarks import uncertainty
from crux_simulation.benchmarks.uncertainty import AS_DRAWN, SCENE, SURE, USUAL, line_of, scenarios_of
from crux_simulation.sim.grip_margin import grip_margins
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.recorder import recorded
from crux_tools.errors import WorkFailed
from crux_tools.robot3d.robot_model import build_model
from hand_plan import Wall, standing_plan
from holding_controller import HoldingController


def test_margins_are_those_of_the_forces_that_physics_solved_for() -> None:
    """Statics of the gripper's wrench against the contact solver's own friction and torsion; holds that are turned as
    grippers are, and further."""
    plan = standing_plan(Wall(yaw_rad=np.array([0.3, -0.2, 0.1, 0.0])))
    for hold, further_rad in zip(plan.holds, (0.1, -0.08, 0.0, 0.05), strict=True):
        hold.yaw_rad += further_rad
    plant = Plant(build_model(load_robot("scaler"), plan), plan, 3)
    controller = HoldingController(plant, squeeze_n=25.0)
    controller.run(2.0)
    while not len(recorded(plant).cycle):
        controller.run(plant.dt_s)
        plant.record(plant.cycle, 1)
    expected, force = np.full(8, np.nan), np.zeros(6)
    for number, contact in enumerate(plant.data.contact):
        pad = plant.robot.pad_of_geom[contact.geom].max()
        mujoco.mj_contactForce(plant.model, plant.data, number, force)
        expected[pad] = 1.0 - np.hypot(np.hypot(*force[1:3]), force[3] / plan.patch_k_m) / (2.2 * force[0])
    found = grip_margins(recorded(plant), plan, plant.robot)[-1].ravel()
    assert expected.min() < 0.5
    assert expected.max() > 0.8
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_the_usual_plan_is_of_the_same_scenario_without_its_uncertainty(tmp_path: Any) -> None:
    usual, sure = (yaml.safe_load(scenarios_of(SCENE)[name]) for name in (USUAL, SURE))
    assert sure.pop("uncertainty") == AS_DRAWN
    assert usual == sure == yaml.safe_load(SCENE.read_text(encoding="utf-8"))
    own = tmp_path / "own.yaml"
    own.write_text(SCENE.read_text(encoding="utf-8") + "uncertainty: {friction: 0.1}\n")
    assert yaml.safe_load(scenarios_of(own)[SURE])["uncertainty"] == {"friction": 0.1}


def row(margin: float | None, slips: int = 0) -> dict[str, Any]:
    climb = {"ok": False} if margin is None else {"ok": True, "slips": slips, "margin": margin}
    return {"walls": USUAL, "reason": "no log", "plan": {"cost": 12.0}, "climb": climb}


def test_least_and_median_are_of_the_climbs_that_were_made() -> None:
    line = line_of([row(0.5), row(0.2, slips=1), row(None), row(0.4)])
    assert (line["climbs"], line["at_goal"], line["slips"], line["fell"]) == (4, 3, 1, 0)
    assert (line["least_margin"], line["median_margin"]) == (0.2, 0.4)
    with pytest.raises(WorkFailed, match="no log"):
        line_of([row(None)])


def test_nothing_is_a_number_of_times_what_is_not_there() -> None:
    assert uncertainty.times(0.3, 0.2) == pytest.approx(1.5)
    assert uncertainty.times(0.03, -0.09) is None


@pytest.mark.parametrize(("margin", "slips", "status"), [(0.75, 0, 0), (0.74, 0, 1), (0.9, 1, 1)])
def test_ok_is_half_as_much_again_without_a_slip(
    margin: float, slips: int, status: int, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    import argparse

    from crux_simulation.campaign import engine

    def run_anew(jobs: Any, *_: Any) -> list[dict[str, Any]]:
        return [
            row(0.5) | {"walls": job.walls} if job.walls == USUAL else row(margin, slips) | {"walls": SURE}
            for job in jobs
        ]

    monkeypatch.setattr(engine, "run_anew", run_anew)
    parser = argparse.ArgumentParser()
    uncertainty.add_arguments(parser)
    options = parser.parse_args(["--count", "2", "--output", str(tmp_path / "out")])
    options.json = True
    assert uncertainty.run(options) == status
