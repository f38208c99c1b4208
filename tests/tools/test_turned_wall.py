"""Holds that are turned out of the wall's plane, in physics: where a ball touches them, and a climb on them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from climbs import climb_here
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_tools.robot3d.wall import add_wall
from crux_tools.telemetry.rotations import hold_middle, hold_quaternion, hold_rotation, hold_top_m
from scipy.spatial.transform import Rotation
from shared_plans import unproven
from test_leaning_wall import RADIUS_M, TEXT
from turned import turned

RPY_RAD = np.array([0.5, -0.4, 1.1])
HOLD = SimpleNamespace(
    name="hold",
    position_w_m=[0.3, -0.2, 0.05], size_m=[0.06, 0.08, 0.1], yaw_rad=RPY_RAD[2], tilt_rad=RPY_RAD[:2].tolist(),
    graspable=1, friction=[2.0, 1.0, 0.5, 0.7, 0.3], spines=[1] * 5, lean_rad=[0.0] * 4,
)  # fmt: skip
TURN = Rotation.from_euler("ZYX", RPY_RAD[::-1])
OUTWARD = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])


def test_a_ball_touches_the_face_where_it_is_turned_to() -> None:
    knot = SimpleNamespace(body_position_w_m=[0.0, 0.0, 0.2])
    spec = mujoco.MjSpec()
    faces = add_wall(spec, SimpleNamespace(scenario_yaml=TEXT, knots=[knot, knot], holds=[HOLD]))
    ball = spec.worldbody.add_body(name="ball", mocap=True)
    ball.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS_M, 0, 0])
    model = spec.compile()
    data, parts = mujoco.MjData(model), [face for face in faces if face.hold == 0]
    half = np.array(HOLD.size_m) / 2
    for outward, friction in zip(OUTWARD, HOLD.friction, strict=True):
        place = [0.0, 0.0, half[2]] + outward * (half + RADIUS_M + 0.004)
        data.mocap_pos[0] = HOLD.position_w_m + TURN.apply(place)
        mujoco.mj_forward(model, data)
        ids = [model.geom(part.geom).id for part in parts]
        away = [mujoco.mj_geomDistance(model, data, model.geom("ball").id, geom, 1.0, None) for geom in ids]
        assert min(away) == pytest.approx(0.004, abs=2e-5)
        assert parts[int(np.argmin(away))].friction == friction


def test_a_hold_is_drawn_where_it_is() -> None:
    np.testing.assert_allclose(hold_rotation(HOLD), TURN.as_matrix(), atol=1e-12)
    w, x, y, z = hold_quaternion(HOLD)
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), TURN.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(hold_middle(HOLD), HOLD.position_w_m + TURN.apply([0.0, 0.0, 0.05]), atol=1e-12)
    corners = [[x, y, z] for x in (-0.03, 0.03) for y in (-0.04, 0.04) for z in (0.0, 0.1)]
    assert hold_top_m(HOLD) == pytest.approx(HOLD.position_w_m[2] + TURN.apply(corners)[:, 2].max())


@pytest.mark.parametrize("roll_deg", [pytest.param(20.0), pytest.param(40.0, marks=pytest.mark.sweep)])
def test_the_robot_climbs_holds_that_are_turned(tmp_path: Path, roll_deg: float) -> None:
    """About 15 s: planning, and a move with grippers that come aslant, by runtime and physics."""
    wall: Any = turned(roll_deg)
    plan = tmp_path / "plan.mcap"
    write_plan(plan, unproven(parse_scenario(wall), load_robot("scaler")).plan)
    status, climbed = climb_here(plan, tmp_path / "log.mcap")
    assert (status, climbed["slips"], climbed["fell"]) == (0, 0, False)
    assert climbed["tracking"]["body_rms_m"] < 0.002
