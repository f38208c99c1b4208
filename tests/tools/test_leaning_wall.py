"""Holds with faces that lean, in physics: where a ball touches them and which face it is; what counts as a slip."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from climbs import climb_here
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_simulation.sim.judge import pad_travel
from crux_tools.paths import SCENARIOS
from crux_tools.robot3d.wall import add_wall
from shared_plans import unproven

LEAN_RAD = np.radians([30.0, 10.0, 0.0, 40.0])
SIZE_M = np.array([0.09, 0.1, 0.05])
YAW_RAD = 0.4
FOOT_M = np.array([0.3, -0.2, 0.0])
RADIUS_M = 0.012
NORMALS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
TEXT = """\
version: 1
name: wall
robot: scaler
wall: {slope_deg: 90}
contact: {model: point}
start: {body: {position_m: [0, 0, 0.185]}, feet: {LF: [0.1, 0.3], RF: [0.1, -0.3], LR: [-0.1, 0.3], RR: [-0.1, -0.3]}}
goal: {body: {position_m: [0.4, 0, 0.185]}}
horizon: {steps: 40, dt_s: 0.08}
"""


def wall(friction: list[float]) -> tuple[mujoco.MjModel, list[Any]]:
    """A wall with one such hold, and a ball that can be anywhere."""
    hold = SimpleNamespace(
        name="hold",
        position_w_m=FOOT_M, size_m=SIZE_M, yaw_rad=YAW_RAD, graspable=1, friction=friction, spines=[1] * 5,
        lean_rad=LEAN_RAD.tolist(), tilt_rad=[0.0, 0.0],
    )  # fmt: skip
    knot = SimpleNamespace(body_position_w_m=[0.0, 0.0, 0.2])
    spec = mujoco.MjSpec()
    faces = add_wall(spec, SimpleNamespace(scenario_yaml=TEXT, knots=[knot, knot], holds=[hold]))
    ball = spec.worldbody.add_body(name="ball", mocap=True)
    ball.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS_M, 0, 0])
    return spec.compile(), faces


@pytest.mark.parametrize("friction", [[2.0] * 5, [2.0, 1.0, 0.5, 0.7, 0.3]])
def test_a_ball_touches_the_face_where_it_leans(friction: list[float]) -> None:
    model, faces = wall(friction)
    data = mujoco.MjData(model)
    turn = np.array([[np.cos(YAW_RAD), -np.sin(YAW_RAD), 0], [np.sin(YAW_RAD), np.cos(YAW_RAD), 0], [0, 0, 1]])
    parts = [face for face in faces if face.hold == 0]
    for which in range(4):
        c, s = np.cos(LEAN_RAD[which]), np.sin(LEAN_RAD[which])
        normal = np.array([*(c * NORMALS[which]), s])
        for height in (0.012, 0.025, 0.04):
            out = SIZE_M[which // 2] / 2 - height * np.tan(LEAN_RAD[which])
            for gap in (0.0, 0.004):
                place = np.array([*(out * NORMALS[which]), height]) + (RADIUS_M + gap) * normal
                data.mocap_pos[0] = FOOT_M + turn @ place
                mujoco.mj_forward(model, data)
                ball = model.geom("ball").id
                away = [
                    mujoco.mj_geomDistance(model, data, ball, model.geom(part.geom).id, 1.0, None) for part in parts
                ]
                assert min(away) == pytest.approx(gap, abs=2e-5)
                assert parts[int(np.argmin(away))].friction == friction[which]


def test_sliding_up_a_leaning_face_is_travel_and_pressing_deeper_is_none() -> None:
    c, s = np.cos(0.6), np.sin(0.6)
    sides = np.array([[[c, 0, s], [-c, 0, s], [0, 1, 0], [0, -1, 0]]])
    positions = np.zeros((2, 3, 8, 3))
    positions[0, 2, 0] = 0.003 * np.array([-s, 0, c])  # up the face of finger 1 of LF
    positions[1, 2, 0] = -0.003 * np.array([c, 0, s])  # into it
    for moved, travel in zip(positions, (0.003, 0.0), strict=True):
        pads: Any = SimpleNamespace(
            pad_force_n=np.full((3, 8), 20.0),
            pad_face=np.zeros((3, 8), dtype=np.int64),
            pad_position_m=moved,
            gripper_rotation=np.tile(np.eye(3), (3, 4, 1, 1)),
        )
        found = pad_travel(pads, np.array([0]), 5.0, sides=sides)
        assert found[0] == pytest.approx(travel, abs=1e-12)


def leaning_ceiling(lean_deg: float) -> str:
    """The shipped ceiling, the faces of its holds leaning so along x."""
    scene = yaml.safe_load((SCENARIOS / "climb-ceiling.yaml").read_text(encoding="utf-8"))
    del scene["wall"]
    for hold in scene["holds"]:
        hold["pose"] = {"position_m": [*hold.pop("position_m"), 0.0]}
        hold["shape"] = {"box_m": [0.09, *hold.pop("size_m")[1:]], "lean_deg": {"+x": lean_deg, "-x": lean_deg}}
    surface = {"name": "wall", "plane": {"point_m": [0, 0, 0], "normal": [0, 0, 1]}}
    return yaml.safe_dump(scene | {"version": 2, "gravity_m_s2": [0, 0, 9.81], "surfaces": [surface]})


@pytest.mark.sweep
def test_on_a_ceiling_the_fingers_close_where_the_plan_has_them(tmp_path: Path) -> None:
    """While the robot is held to it, grippers that left their places would grip beside them on faces that lean."""
    plan = tmp_path / "plan.mcap"
    write_plan(plan, unproven(parse_scenario(leaning_ceiling(20.0), "ceiling.yaml"), load_robot("scaler")).plan)
    status, climbed = climb_here(plan, tmp_path / "log.mcap")
    assert (status, climbed["slips"], climbed["fell"]) == (0, 0, False)
    assert climbed["tracking"]["body_rms_m"] < 0.002
