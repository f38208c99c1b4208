"""The robot on a sketch: what it looks like, and its joints where body and grasps are given."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Grip, Hold, Scenario
from crux_contracts.scenario_bodies import SIDE_FACES
from crux_msgs import plan_knot_t, plan_t
from crux_planner import Faces
from crux_tools.robot3d.robot_model import build_model
from crux_tools.robot3d.start_pose import solve_limb
from crux_tools.telemetry.rotations import rotation_from_rpy
from crux_tools.view.bodies import Bodies
from crux_tools.view.meshes import drawn_mesh, meshes_of

from crux_simulation.wall.edit.content import Content

STARTS = 4  # of the search for a posture


def _bare_wall(robot: Robot, scenario: Scenario) -> plan_t:
    """A plan of nothing, for a model of the robot without holds."""
    plan = plan_t()
    plan.gravity_w_m_s2 = list(scenario.wall.gravity_w_m_s2)
    plan.scenario_yaml, plan.scenario_name, plan.robot_name = scenario.yaml_text, scenario.name, robot.name
    plan.knots = [plan_knot_t()]
    return plan


class Ghost:
    """One robot; not for two threads at once."""

    def __init__(self, robot: Robot, scenario: Scenario) -> None:
        self._robot = build_model(robot, _bare_wall(robot, scenario))
        self._described = robot
        self._data = mujoco.MjData(self._robot.model)
        mujoco.mj_kinematics(self._robot.model, self._data)
        self._bodies = Bodies(self._robot, self._data)
        meshes = {link: [drawn_mesh(mesh) for mesh in found] for link, found in meshes_of(robot).items()}
        self.shapes = [shape for shape in self._bodies.shapes(meshes) if shape["body"] >= 0]

    def stand(self, bodies: list[Content], body: Content, grasps: dict[str, Content]) -> list[float]:
        """Poses of the robot's bodies, x, y, z, then w, x, y, z, each, in W [m]. A limb whose grasp is not there, or is
        out of its reach, is drawn as near to it as it gets. Raises KeyError, TypeError, ValueError for what is no pose.
        """
        rpy_rad = np.radians(np.array(body.get("rpy_deg") or (0.0, 0.0, 0.0), dtype=float))
        data = self._data
        data.qpos[:] = self._robot.model.qpos0
        data.qpos[:3] = np.array(body["position_m"], dtype=float)
        mujoco.mju_mat2Quat(data.qpos[3:7], rotation_from_rpy(rpy_rad).ravel())
        named = {each["name"]: each for each in bodies if not each["obstacle"]}
        for limb, name in enumerate(LIMB_NAMES):
            grasp = grasps.get(name)
            if grasp is None or grasp["hold"] not in named:
                continue
            place = self._place(named[grasp["hold"]], grasp, float(rpy_rad[2]))
            if place is None:
                continue
            position, turn, half_m = place
            data.qpos[self._robot.finger_qpos[limb]] = half_m
            solve_limb(self._robot, data, limb, position, turn, starts=STARTS)
        mujoco.mj_kinematics(self._robot.model, data)
        return self._bodies.poses(data)

    def _place(self, hold: Content, grasp: Content, heading_rad: float) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Where a gripper's middle is by a grasp, its rotation (3, 3), and from there to a pad's face."""
        pair, which = "xy".index(grasp["faces"]), int(grasp.get("grip", 0))
        lean_deg = tuple(float(hold["lean_deg"].get(face, 0.0)) for face in SIDE_FACES)
        x, y, z = map(float, hold["size_m"])
        grips = tuple(Grip(**grip) for grip in hold.get("grips", []))
        as_hold = Hold(name="hold", position_m=(0.0, 0.0), size_m=(x, y, z), lean_deg=lean_deg, grips=grips)
        places = as_hold.places(grasp["faces"])
        if which >= len(places):
            return None
        grip = places[which]
        faces = Faces.of(as_hold, pair, self._described, self._described.gripper.pad_radius_m, grip)
        if faces is None:
            return None
        along = math.radians(hold["yaw_deg"]) + pair * math.pi / 2
        yaw = heading_rad + math.remainder(along - heading_rad, math.pi)  # either finger may be on either face
        aslant = 0.0 if grip is None else grip.tilt_rad * math.cos(yaw - along)
        off = faces.off_m * np.array([math.cos(along), math.sin(along)])
        off += faces.aside_m * np.array([-math.sin(along), math.cos(along)])
        return (
            np.array([*(np.array(hold["position_m"], dtype=float) + off), faces.height_m]),
            rotation_from_rpy([aslant, 0.0, yaw]),
            faces.half_m,
        )
