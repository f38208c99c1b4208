"""Walls of bounded surfaces in physics and as markers: where the surfaces are, and climbs over an edge."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import crux_planner
import mujoco
import numpy as np
import pytest
import yaml
from climbs import climb_here
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_simulation.benchmarks.many_walls import WALLS
from crux_tools.robot3d.wall import add_wall
from edges import CHIMNEY, CONCAVE, CONVEX, CONVEX_60, chimney, edge
from shared_plans import unproven

RADIUS_M = 0.012


@pytest.mark.parametrize("given", [CONVEX, CONCAVE], ids=["convex", "concave"])
def test_a_ball_touches_the_surfaces_where_they_are(given: tuple[float, float, float]) -> None:
    """0.2 m off the edge along either plane, 5 mm above it; and nothing is there without surfaces."""
    scene = edge(*given)
    knot = SimpleNamespace(body_position_w_m=[0.0, 0.0, 0.2])
    spec = mujoco.MjSpec()
    faces = add_wall(spec, SimpleNamespace(scenario_yaml=yaml.safe_dump(scene), knots=[knot, knot], holds=[]))
    assert [face.geom for face in faces] == ["wall0", "wall1"]
    ball = spec.worldbody.add_body(name="ball", mocap=True)
    ball.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS_M, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    for index, (side, rise) in enumerate(zip((-1.0, 1.0), np.radians(given[:2]), strict=True)):
        along, off = np.array([np.cos(rise), 0.0, np.sin(rise)]), np.array([-np.sin(rise), 0.0, np.cos(rise)])
        data.mocap_pos[0] = np.array([0.21, 0.3, given[2]]) + 0.2 * side * along + (RADIUS_M + 0.005) * off
        mujoco.mj_forward(model, data)
        ids = [model.geom(face.geom).id for face in faces]
        gaps = [mujoco.mj_geomDistance(model, data, model.geom("ball").id, geom, 1.0, None) for geom in ids]
        assert gaps[index] == pytest.approx(0.005, abs=2e-5)
        assert gaps[1 - index] > 0.05


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(edge(*CONVEX), id="convex"),
        pytest.param(edge(*CONCAVE), id="concave", marks=pytest.mark.sweep),
        pytest.param(edge(*CONVEX_60), id="convex-60", marks=pytest.mark.sweep),
        pytest.param(chimney(*CHIMNEY), id="chimney", marks=pytest.mark.sweep),
    ],
)
def test_the_robot_climbs_from_plane_to_plane(tmp_path: Path, scene: dict[str, Any]) -> None:
    """About 20 s: planning, and a round of four moves by runtime and physics."""
    plan = tmp_path / "plan.mcap"
    write_plan(plan, unproven(parse_scenario(scene), load_robot("scaler")).plan)
    status, climbed = climb_here(plan, tmp_path / "log.mcap")
    assert (status, climbed["slips"], climbed["fell"]) == (0, 0, False)
    assert climbed["tracking"]["body_rms_m"] < 0.002


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("name", "turns_deg"), [("floor-wall-90", 90.0), ("wall-ceiling-150", 60.0), ("room-150", 150.0)]
)
def test_the_robot_climbs_from_a_floor_to_a_ceiling(tmp_path: Path, name: str, turns_deg: float) -> None:
    """About 4 minutes, most in the room: the body turns with the planes, from the floor to below the ceiling."""
    plan, robot = tmp_path / "plan.mcap", load_robot("scaler")
    result = crux_planner.plan(load_scenario(WALLS / f"{name}.yaml"), robot, time_limit_s=200.0)
    pitch = [knot.body_rpy_rad[1] for knot in (result.plan.knots[0], result.plan.knots[-1])]
    assert np.degrees(pitch[0] - pitch[1]) == pytest.approx(turns_deg, abs=3.0)
    write_plan(plan, result.plan)
    status, climbed = climb_here(plan, tmp_path / "log.mcap")
    assert (status, climbed["slips"], climbed["fell"]) == (0, 0, False)
