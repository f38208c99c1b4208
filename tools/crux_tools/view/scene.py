"""The robot, its wall and the forces in a browser: a viser scene that shows any row of a recording.

Shapes and kinematics come from the bench's MuJoCo model of the robot description: what the view shows is what the
measured joint angles mean, not what the runtime believes of its grippers. The plan is the same robot, transparent, at
the references of body and grippers.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

import mujoco
import numpy as np
import viser
from crux_contracts import LIMB_NAMES

from crux_tools.log.markers import margin_colours
from crux_tools.report.pictures import place_measured
from crux_tools.robot3d.robot_model import build_model
from crux_tools.robot3d.start_pose import solve_limb
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.description import robot_of
from crux_tools.telemetry.plan_series import PlanSeries, plan_series
from crux_tools.telemetry.summary import STATE_NAMES, WAIT_NAMES, name_of
from crux_tools.view.meshes import add_meshes, meshes_of
from crux_tools.view.recording import Recording

FORCE_SCALE_M_PER_N = 0.008
MOMENT_SCALE_M_PER_NM = 0.1
ARROWS = {  # name -> (field of limb_telemetry, length of a unit, colour)
    "measured force": ("force_w_n", FORCE_SCALE_M_PER_N, (36, 101, 176)),
    "planned force": ("force_reference_w_n", FORCE_SCALE_M_PER_N, (230, 150, 40)),
    "measured moment": ("moment_w_nm", MOMENT_SCALE_M_PER_NM, (120, 175, 235)),
    "planned moment": ("moment_reference_w_nm", MOMENT_SCALE_M_PER_NM, (250, 205, 130)),
}
GHOST_RGB = (30, 160, 160)
GHOST_OPACITY = 0.3
CAMERAS = {  # name -> where the eye is from what it looks at, frame W [m]
    "overview": (-0.7, -0.55, 0.75),
    "wall": (-0.1, 0.0, 1.7),
    "right": (0.0, -1.4, 0.2),
    "left": (0.0, 1.4, 0.2),
    "below": (-1.5, 0.0, 0.35),
    **{limb: (-0.3, -0.25 if limb[0] == "R" else 0.25, 0.3) for limb in LIMB_NAMES},
}


def _rgb(rgba: np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (int(255 * channel) for channel in rgba[:3])
    return red, green, blue


class Scene:
    """Everything that is drawn of one recording; `show` moves it to a row."""

    def __init__(self, server: viser.ViserServer, recording: Recording) -> None:
        self._server, self._recording = server, recording
        plan = recording.log.plan
        self._plan: PlanSeries = plan_series(plan)
        with robot_of(plan.robot_name, recording.log.robot_files) as described:
            self._robot = build_model(described, plan)
            meshes = meshes_of(described)
        self._data, self._ghost_data = (mujoco.MjData(self._robot.model) for _ in range(2))
        mujoco.mj_kinematics(self._robot.model, self._data)
        up = -np.array(plan.gravity_w_m_s2)
        server.scene.set_up_direction(up / np.linalg.norm(up))
        server.scene.configure_default_lights(cast_shadow=False)  # they cost most of a frame without a graphics card
        self._holds: dict[int, list[Any]] = {}
        self._frames = self._add_bodies("model", meshes)
        self._ghost = self._add_bodies("plan", meshes, GHOST_RGB)
        self._arrows = {name: self._add_arrows(name, rgb) for name, (_, _, rgb) in ARROWS.items()}
        self._coloured: dict[int, tuple[int, int, int]] = {}
        self._follow = False
        self._body_m = recording.log.state["body_position_w_m"][0]
        server.initial_camera.position = tuple(self._body_m + CAMERAS["overview"])
        server.initial_camera.look_at = tuple(self._body_m)
        self._add_switches()

    def _add_switches(self) -> None:
        gui = self._server.gui
        plan = gui.add_checkbox("plan", initial_value=True)
        forces = gui.add_checkbox("forces", initial_value=True)
        moments = gui.add_checkbox("moments", initial_value=False)
        follow = gui.add_checkbox("camera follows", initial_value=False)
        gui.main_panel.minimize()

        def switch(_: Any = None) -> None:
            self._follow = follow.value
            for _, frame in self._ghost:
                frame.visible = plan.value
            for name, arrows in self._arrows.items():
                wanted = forces.value if "force" in name else moments.value
                arrows.visible = wanted and (plan.value or "planned" not in name)

        for box in (plan, forces, moments, follow):
            box.on_update(switch)
        switch()

    def _add_bodies(
        self, root: str, meshes: dict[str, list[Any]], rgb: tuple[int, int, int] | None = None
    ) -> list[tuple[int, Any]]:
        """Adds the geometry, with `rgb` a ghost of what moves; returns (body index, frame) of the bodies that move."""
        model, scene = self._robot.model, self._server.scene
        frames = []
        for body in range(model.nbody):
            moves = model.body_weldid[body] != 0
            if rgb is not None and not moves:
                continue
            label = PurePosixPath(model.body(body).name or "world").name
            name = f"/{root}/{label}_{body}"
            place = {"position": self._data.xpos[body], "wxyz": self._data.xquat[body]}
            frame = scene.add_frame(name, show_axes=False, **place)
            if label in meshes:
                add_meshes(scene, name, meshes[label], rgb, GHOST_OPACITY)
            for geom in np.flatnonzero(model.geom_bodyid == body):
                if label not in meshes or geom in self._robot.pad_geoms:
                    self._add_geom(f"{name}/{geom}", int(geom), rgb)
            if moves:
                frames.append((body, frame))
        return frames

    def _add_geom(self, name: str, geom: int, ghost_rgb: tuple[int, int, int] | None) -> None:
        model, scene = self._robot.model, self._server.scene
        size, colour = model.geom_size[geom], ghost_rgb or _rgb(model.geom_rgba[geom])
        more: dict[str, Any] = {"position": model.geom_pos[geom], "wxyz": model.geom_quat[geom]}
        if ghost_rgb is not None:
            more |= {"opacity": GHOST_OPACITY, "cast_shadow": False}
        kind = mujoco.mjtGeom(model.geom_type[geom])
        if kind == mujoco.mjtGeom.mjGEOM_PLANE:
            scene.add_box(name, color=colour, dimensions=(2 * size[0], 2 * size[1], 0.002), **more)
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            box = scene.add_box(name, color=colour, dimensions=tuple(2 * size), **more)
            face = self._robot.face_of_geom[geom]
            if face >= 0 and self._robot.face_hold[face] >= 0:
                self._holds.setdefault(int(self._robot.face_hold[face]), []).append((box, colour))
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            scene.add_icosphere(name, radius=float(size[0]), color=colour, **more)
        elif kind in {mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER}:
            scene.add_cylinder(name, radius=float(size[0]), height=float(2 * size[1]), color=colour, **more)

    def _add_arrows(self, name: str, colour: tuple[int, int, int]) -> Any:
        points = np.zeros((len(LIMB_NAMES), 2, 3), dtype=np.float32)
        return self._server.scene.add_arrows(
            f"/{name}", points, colour, shaft_radius=0.006, head_radius=0.014, head_length=0.025
        )

    def show(self, row: int, recording: Recording | None = None) -> None:
        """Moves everything to a row, of a recording that has grown where one is given."""
        if recording is not None and recording.log.plan is not self._recording.log.plan:
            self._plan = plan_series(recording.log.plan)
        self._recording = recording or self._recording
        log, model, data = self._recording.log, self._robot.model, self._data
        place_measured(self._robot, data, log, row)
        mujoco.mj_kinematics(model, data)
        self._place_ghost(log, row)
        for frames, placed in ((self._frames, data), (self._ghost, self._ghost_data)):
            for body, frame in frames:
                frame.position, frame.wxyz = placed.xpos[body], placed.xquat[body]
        at = data.site_xpos[self._robot.gripper_sites]
        for name, (field, scale, _) in ARROWS.items():
            tips = at + scale * log.limbs[field][row]
            self._arrows[name].points = np.stack([at, tips], axis=1).astype(np.float32)
        self._colour_holds(row)
        moved = data.xpos[self._robot.body] - self._body_m
        self._body_m = data.xpos[self._robot.body].copy()
        if self._follow and moved.any():
            self._move_cameras(lambda camera: camera.position + moved, None)

    def _place_ghost(self, log: Telemetry, row: int) -> None:
        state, references, ghost = log.state[row], log.references[row], self._ghost_data
        ghost.qpos[:] = self._data.qpos
        ghost.qpos[:3] = state["body_reference_position_w_m"]
        ghost.qpos[3:7] = state["body_reference_quaternion_w"]
        ghost.qpos[self._robot.finger_qpos] = references["finger_opening_m"][:, None]
        for limb in range(len(LIMB_NAMES)):
            place = references["gripper_position_w_m"][limb], float(references["gripper_yaw_w_rad"][limb])
            solve_limb(self._robot, ghost, limb, *place, near=True)
        mujoco.mj_kinematics(self._robot.model, ghost)

    def _colour_holds(self, row: int) -> None:
        """Those that are held, by the least margin of the limbs on them; the others as they are."""
        margin = self._recording.margin_n[row]
        knot = self._plan.knot_at(self._recording.log.state["plan_time_s"][row])
        wanted: dict[int, tuple[int, int, int]] = {}
        for limb in np.argsort(-margin):  # the least last; NaN comes last of all
            hold = int(self._plan.hold[knot, limb])
            if hold >= 0 and np.isfinite(margin[limb]):
                wanted[hold] = _rgb(margin_colours(margin[limb : limb + 1])[0])
        for hold in {*wanted, *self._coloured}:
            if wanted.get(hold) != self._coloured.get(hold):
                for box, own in self._holds[hold]:
                    box.color = wanted.get(hold, own)
        self._coloured = wanted

    def look(self, name: str) -> None:
        """Moves the cameras of all who look to one of CAMERAS."""
        at = self._data.site_xpos[self._robot.gripper_sites[LIMB_NAMES.index(name)]] if name in LIMB_NAMES else None
        at = self._body_m if at is None else at
        self._server.initial_camera.position = tuple(at + CAMERAS[name])
        self._server.initial_camera.look_at = tuple(at)
        self._move_cameras(lambda _: at + CAMERAS[name], at)

    def _move_cameras(self, eye: Any, at: np.ndarray | None) -> None:
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position = eye(client.camera)
                if at is not None:
                    client.camera.look_at = at

    def drawn(self) -> dict[str, Any]:
        """Where body and plan are drawn, how long the arrows are, frame W [m], and which holds have which colour."""
        both = {"body": self._frames, "plan body": self._ghost}
        places: dict[str, Any] = {name: dict(frames)[self._robot.body].position for name, frames in both.items()}
        for kind, arrows in self._arrows.items():
            for limb, (tail, tip) in zip(LIMB_NAMES, arrows.points, strict=True):
                places[f"{kind} {limb}"] = tip - tail
        return places | {"holds": dict(self._coloured)}


def caption(recording: Recording, row: int) -> list[str]:
    """One row in words, a line each."""
    log = recording.log
    state = log.state[row]
    error_mm = 1e3 * np.linalg.norm(state["body_position_w_m"] - state["body_reference_position_w_m"])
    waiting = int(state["waiting_for"])
    limb = int(state["waiting_limb"])
    wait = f"waits for {LIMB_NAMES[limb] if limb >= 0 else 'all limbs'} to {name_of(WAIT_NAMES, waiting)}"
    grasp = ", ".join(
        f"{name} {force:.0f}" for name, force in zip(LIMB_NAMES, log.limbs["grasp_force_n"][row], strict=True)
    )
    margins = zip(LIMB_NAMES, recording.margin_n[row], strict=True)
    margin = ", ".join(f"{name} {'–' if np.isnan(value) else f'{value:.1f}'}" for name, value in margins)
    return [
        f"{name_of(STATE_NAMES, int(state['supervisor_state']))}, cycle {state['cycle']}, plan time "
        f"{state['plan_time_s']:.2f} s" + (f", {wait}" if waiting else ""),
        f"body {error_mm:.1f} mm off its reference",
        f"margin [N]: {margin}",
        f"grasp [N]: {grasp}",
    ]
