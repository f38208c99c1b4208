"""The robot, its wall and the forces for the 3-D view: what there is to draw, and where it is at any row.

Shapes and kinematics come from the simulation's MuJoCo model of the robot description: what the view shows is what the
measured joint angles mean, not what the runtime believes of its grippers. The plan is the same robot, transparent, at
the references of body and grippers.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.plan_series import PlanSeries, plan_series
from crux_planner.checker.limb_model import load_model

from crux_tools.log.markers import USED_RGB, used_colours
from crux_tools.report.pictures import place_measured
from crux_tools.robot3d.robot_model import build_model
from crux_tools.robot3d.start_pose import solve_limb
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.actuators import joints_rad
from crux_tools.telemetry.description import robot_of
from crux_tools.telemetry.rotations import hold_middle, hold_top_m, rotations_from_quaternions, tilts_of
from crux_tools.view.bodies import Bodies, numbers, rgb_of
from crux_tools.view.caption import caption
from crux_tools.view.grip_marks import marks_of
from crux_tools.view.meshes import drawn_mesh, meshes_of
from crux_tools.view.reach import reach_on_wall
from crux_tools.view.recording import Recording

FORCE_SCALE_M_PER_N = 0.008
MOMENT_SCALE_M_PER_NM = 0.1
ARROWS = {  # name -> (field of limb_telemetry, length of a unit, colour)
    "measured force": ("force_w_n", FORCE_SCALE_M_PER_N, (36, 101, 176)),
    "planned force": ("force_reference_w_n", FORCE_SCALE_M_PER_N, (230, 150, 40)),
    "measured moment": ("moment_w_nm", MOMENT_SCALE_M_PER_NM, (120, 175, 235)),
    "planned moment": ("moment_reference_w_nm", MOMENT_SCALE_M_PER_NM, (250, 205, 130)),
}
CAMERAS = {  # name -> where the eye is from what it looks at, frame W [m]: a gripper, or the body
    "overview": (-0.79, -0.63, 0.86),
    "wall": (-0.1, 0.0, 1.7),
    "right": (0.0, -1.4, 0.2),
    "left": (0.0, 1.4, 0.2),
    "below": (-1.5, 0.0, 0.35),
    **{limb: (-0.3, -0.25 if limb[0] == "R" else 0.25, 0.3) for limb in LIMB_NAMES},
}


class Scene:
    """One recording's: `description` is what there is, `at` where it is in a row."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        plan = recording.log.plan
        self._plan: PlanSeries = plan_series(plan)
        with robot_of(plan.robot_name, recording.log.robot_files) as described:
            self._robot = build_model(described, plan)
            self._whole = load_model(described)
            meshes = {link: [drawn_mesh(mesh) for mesh in found] for link, found in meshes_of(described).items()}
            marks = marks_of(plan, described)
        self._data, self._ghost_data = (mujoco.MjData(self._robot.model) for _ in range(2))
        mujoco.mj_kinematics(self._robot.model, self._data)
        self._bodies = Bodies(self._robot, self._data)
        up = -np.array(plan.gravity_w_m_s2)
        frames = [self._robot.body, *self._robot.gripper_bodies]
        self.description: dict[str, Any] = {
            "up": numbers(up / np.linalg.norm(up)),
            "shapes": self._bodies.shapes(meshes) + marks,
            "arrows": {name: rgb for name, (_, _, rgb) in ARROWS.items()},
            "cameras": CAMERAS,
            "grippers": LIMB_NAMES,
            "holds": [
                {"name": hold.name, "top": numbers(np.array([*hold_middle(hold)[:2], hold_top_m(hold)]))}
                for hold in plan.holds
            ],
            "joints": self._joints(),
            "frames": dict(
                zip(("body", *LIMB_NAMES), np.searchsorted(self._bodies.moving, frames).tolist(), strict=True)
            ),
            "used_rgb": [[share, rgb_of(np.array(rgb))] for share, rgb in USED_RGB],
        }

    def _joints(self) -> list[dict[str, Any]]:
        """Names and limits [rad], limb by limb, in the order of `at`'s "joints"."""
        model = self._robot.model
        joints = model.dof_jntid[self._robot.joint_dof]
        return [
            {"name": model.joint(int(number)).name, "limits": numbers(model.jnt_range[number])} for number in joints
        ]

    def at(self, row: int, recording: Recording) -> dict[str, Any]:
        """Poses of the bodies that move, measured and planned (x, y, z, then w, x, y, z, each), arrows from the
        grippers, and colours of the holds that are held. `recording` may have grown since the last time.
        """
        self._follow(recording)
        log, model, data = recording.log, self._robot.model, self._data
        place_measured(self._robot, data, log, row)
        mujoco.mj_kinematics(model, data)
        self._place_ghost(log, row)
        return {
            "measured": self._bodies.poses(data),
            "planned": self._bodies.poses(self._ghost_data),
            "body": numbers(data.xpos[self._robot.body]),
            "planned_body": numbers(self._ghost_data.xpos[self._robot.body]),
            "grippers": numbers(data.site_xpos[self._robot.gripper_sites]),
            "arrows": {name: numbers(scale * log.limbs[field][row]) for name, (field, scale, _) in ARROWS.items()},
            "holds": self._hold_colours(row),
            "joints": numbers(joints_rad(self._robot.robot, log.inputs["joint_position_rad"][row])),
        }

    def caption(self, row: int, recording: Recording) -> dict[str, Any]:
        """A moment in words and figures."""
        self._follow(recording)
        return caption(recording, row, self._plan)

    def reach(self, row: int, recording: Recording) -> dict[str, list[float]]:
        """Where every gripper can stand while the body stays, at its present height and yaw: (3 m,) places by limb."""
        self._follow(recording)
        state, references = recording.log.state[row], recording.log.references[row]
        rotation = rotations_from_quaternions(state["body_quaternion_w"][None])[0]
        grippers, yaws = recording.log.limbs["gripper_position_w_m"][row], references["gripper_yaw_w_rad"]
        found = reach_on_wall(self._whole, state["body_position_w_m"], rotation, grippers, yaws)
        return {limb.name: numbers(places) for limb, places in zip(self._whole.limbs, found, strict=True)}

    def _follow(self, recording: Recording) -> None:
        """It may have grown since the last time, or have another plan on the same wall."""
        if recording.log.plan is not self._recording.log.plan:
            self._plan = plan_series(recording.log.plan)
        self._recording = recording

    def _place_ghost(self, log: Telemetry, row: int) -> None:
        state, references, ghost = log.state[row], log.references[row], self._ghost_data
        ghost.qpos[:] = self._data.qpos
        ghost.qpos[:3] = state["body_reference_position_w_m"]
        ghost.qpos[3:7] = state["body_reference_quaternion_w"]
        ghost.qpos[self._robot.finger_qpos] = references["finger_opening_m"][:, None]
        turned = gripper_rotation(references["gripper_yaw_w_rad"], tilts_of(references))
        for limb in range(len(LIMB_NAMES)):
            solve_limb(self._robot, ghost, limb, references["gripper_position_w_m"][limb], turned[limb], near=True)
        mujoco.mj_kinematics(self._robot.model, ghost)

    def _hold_colours(self, row: int) -> dict[int, list[int]]:
        """Those that are held, by the largest share of the limit surface that a limb uses; others are as they are."""
        used = self._recording.grip.used[row]
        knot = self._plan.knot_at(self._recording.log.state["plan_time_s"][row])
        wanted: dict[int, list[int]] = {}
        for limb in np.argsort(used):  # the largest last; NaN comes last of all
            hold = int(self._plan.hold[knot, limb])
            if hold >= 0 and not np.isnan(used[limb]):
                wanted[hold] = rgb_of(used_colours(used[limb : limb + 1])[0])
        return wanted
