"""The robot, its wall and the forces in a browser: a viser scene that shows any cycle of a log.

Shapes and kinematics come from the bench's MuJoCo model of the robot description: what the view shows is what the
measured joint angles mean, not what the runtime believes of its grippers.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

import mujoco
import numpy as np
import viser
from crux_contracts import LIMB_NAMES

from crux_tools.report.pictures import place_measured
from crux_tools.sim.robot_model import build_model
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.description import robot_of
from crux_tools.telemetry.summary import STATE_NAMES, WAIT_NAMES, name_of

FORCE_SCALE_M_PER_N = 0.004
MEASURED_RGB = (36, 101, 176)
PLANNED_RGB = (230, 150, 40)
GHOST_RGB = (230, 150, 40)
GHOST_OPACITY = 0.35
GRIPPER_BOX_M = (0.14, 0.024, 0.02)  # of a planned gripper; its fingers reach down from there
EYE_W_M = np.array([-0.95, -0.75, 1.0])


def _rgb(rgba: np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (int(255 * channel) for channel in rgba[:3])
    return red, green, blue


def _quaternion_about_z(angle_rad: float) -> tuple[float, float, float, float]:
    return float(np.cos(angle_rad / 2)), 0.0, 0.0, float(np.sin(angle_rad / 2))


class ReplayScene:
    """Everything that is drawn; `show` moves it to one row of the log."""

    def __init__(self, server: viser.ViserServer, log: Telemetry) -> None:
        self._log = log
        with robot_of(log.plan.robot_name, log.robot_files) as described:
            self._robot = build_model(described, log.plan)
        self._data = mujoco.MjData(self._robot.model)
        self._scene = server.scene
        up = -np.array(log.plan.gravity_w_m_s2)
        self._scene.set_up_direction(up / np.linalg.norm(up))
        self._frames = self._add_model()
        self._ghost_body = self._add_ghost("body", (0.30, 0.22, 0.06))
        self._ghost_grippers = [self._add_ghost(name, GRIPPER_BOX_M) for name in LIMB_NAMES]
        self._arrows = {
            name: self._add_arrows(name, colour)
            for name, colour in (("measured", MEASURED_RGB), ("planned", PLANNED_RGB))
        }
        start = log.state["body_position_w_m"][0]
        server.initial_camera.position = tuple(start + EYE_W_M)
        server.initial_camera.look_at = tuple(start)

    def _add_model(self) -> list[tuple[int, Any]]:
        """Adds all geometry; returns (body index, frame) of the bodies that move."""
        model = self._robot.model
        mujoco.mj_kinematics(model, self._data)
        frames = []
        for body in range(model.nbody):
            name = f"/model/{PurePosixPath(model.body(body).name or 'world').name}_{body}"
            frame = self._scene.add_frame(
                name, show_axes=False, position=self._data.xpos[body], wxyz=self._data.xquat[body]
            )
            for geom in np.flatnonzero(model.geom_bodyid == body):
                self._add_geom(f"{name}/{geom}", int(geom))
            if model.body_weldid[body] != 0:
                frames.append((body, frame))
        return frames

    def _add_geom(self, name: str, geom: int) -> None:
        model = self._robot.model
        size, colour = model.geom_size[geom], _rgb(model.geom_rgba[geom])
        place = {"position": model.geom_pos[geom], "wxyz": model.geom_quat[geom]}
        kind = mujoco.mjtGeom(model.geom_type[geom])
        if kind == mujoco.mjtGeom.mjGEOM_PLANE:
            self._scene.add_box(name, colour, (2 * size[0], 2 * size[1], 0.002), **place)
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            self._scene.add_box(name, colour, tuple(2 * size), **place)
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            self._scene.add_icosphere(name, float(size[0]), colour, **place)
        elif kind in {mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER}:
            self._scene.add_cylinder(name, float(size[0]), float(2 * size[1]), colour, **place)

    def _add_arrows(self, name: str, colour: tuple[int, int, int]) -> Any:
        points = np.zeros((len(LIMB_NAMES), 2, 3), dtype=np.float32)
        return self._scene.add_arrows(
            f"/forces/{name}", points, colour, shaft_radius=0.004, head_radius=0.009, head_length=0.02
        )

    def _add_ghost(self, name: str, size_m: tuple[float, float, float]) -> Any:
        return self._scene.add_box(f"/plan/{name}", GHOST_RGB, size_m, opacity=GHOST_OPACITY, cast_shadow=False)

    def show(self, row: int) -> None:
        """Moves everything to one row of the log."""
        log, data = self._log, self._data
        place_measured(self._robot, data, log, row)
        mujoco.mj_kinematics(self._robot.model, data)
        for body, frame in self._frames:
            frame.position, frame.wxyz = data.xpos[body], data.xquat[body]
        state, references, limbs = log.state[row], log.references[row], log.limbs[row]
        self._ghost_body.position = state["body_reference_position_w_m"]
        self._ghost_body.wxyz = state["body_reference_quaternion_w"]
        for limb, ghost in enumerate(self._ghost_grippers):
            ghost.position = references["gripper_position_w_m"][limb]
            ghost.wxyz = _quaternion_about_z(float(references["gripper_yaw_w_rad"][limb]))
        at = data.site_xpos[self._robot.gripper_sites]
        for name, force in (("measured", limbs["force_w_n"]), ("planned", limbs["force_reference_w_n"])):
            self._arrows[name].points = np.stack([at, at + FORCE_SCALE_M_PER_N * force], axis=1).astype(np.float32)

    def drawn(self) -> dict[str, np.ndarray]:
        """Where body and plan are drawn and how long the force arrows are, frame W [m]."""
        frame = next(frame for body, frame in self._frames if body == self._robot.body)
        places = {"body": frame.position, "plan body": self._ghost_body.position}
        for kind, arrows in self._arrows.items():
            for limb, (tail, tip) in zip(LIMB_NAMES, arrows.points, strict=True):
                places[f"{kind} force {limb}"] = tip - tail
        return places

    def show_plan(self, visible: bool) -> None:
        """Shows or hides what the plan asked for."""
        for part in (self._ghost_body, *self._ghost_grippers, self._arrows["planned"]):
            part.visible = visible


def caption(log: Telemetry, row: int) -> str:
    """One row in words (Markdown), for the panel beside the view."""
    state = log.state[row]
    error_mm = 1e3 * np.linalg.norm(state["body_position_w_m"] - state["body_reference_position_w_m"])
    waiting = int(state["waiting_for"])
    limb = int(state["waiting_limb"])
    wait = f"waits for {LIMB_NAMES[limb] if limb >= 0 else 'all limbs'} to {name_of(WAIT_NAMES, waiting)}"
    forces = zip(LIMB_NAMES, log.limbs["grasp_force_n"][row], strict=True)
    grasp = ", ".join(f"{name} {force:.0f}" for name, force in forces)
    return "\n\n".join(
        [
            f"**{name_of(STATE_NAMES, int(state['supervisor_state']))}**, plan time {state['plan_time_s']:.2f} s"
            + (f", {wait}" if waiting else ""),
            f"body {error_mm:.1f} mm off",
            f"grasp [N]: {grasp}",
        ]
    )
