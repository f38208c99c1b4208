"""The bodies of a robot's model for the 3-D view: their shapes, and where they are."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

import mujoco
import numpy as np

from crux_tools.robot3d.robot_model import RobotModel

DIGITS = 6  # of positions [m] and quaternions
Shape = dict[str, Any]


def rgb_of(rgba: np.ndarray) -> list[int]:
    """Of a colour, as the page has it."""
    return [int(255 * channel) for channel in rgba[:3]]


def numbers(values: Any) -> list[float]:
    """JSON has no NaN: what is not known is 0."""
    found: list[float] = np.round(np.nan_to_num(np.asarray(values, dtype=float).ravel()), DIGITS).tolist()
    return found


class Bodies:
    """Those of one model; `data`, after mj_kinematics, says where what never moves is. `moving`: the numbers of the
    bodies that do.
    """

    def __init__(self, robot: RobotModel, data: mujoco.MjData) -> None:
        self._robot, self._data = robot, data
        self.moving = np.flatnonzero(robot.model.body_weldid != 0)

    def shapes(self, meshes: dict[str, list[Shape]]) -> list[Shape]:
        """Those of a body that moves stand in its frame, `body` counting such bodies; all others, -1, in W."""
        model, found = self._robot.model, []
        for body in range(model.nbody):
            moves = int(np.searchsorted(self.moving, body)) if body in self.moving else -1
            link = PurePosixPath(model.body(body).name or "world").name
            if link in meshes:
                found += [{**mesh, "body": moves, "hold": -1} for mesh in meshes[link]]
            for geom in np.flatnonzero(model.geom_bodyid == body):
                seen = model.geom_rgba[geom, 3] > 0
                if (seen and link not in meshes) or geom in self._robot.pad_geoms:
                    found += self._shapes_of(int(geom), moves)
        return found

    def _shapes_of(self, geom: int, body: int) -> list[Shape]:
        """`size` is what it measures along its own axes."""
        model = self._robot.model
        size, face = model.geom_size[geom], self._robot.face_of_geom[geom]
        place = (
            (model.geom_pos[geom], model.geom_quat[geom])
            if body >= 0
            else (self._data.geom_xpos[geom], _quaternion(self._data.geom_xmat[geom]))
        )
        radius, length = size[0], 2 * size[1]
        kind = mujoco.mjtGeom(model.geom_type[geom])
        parts: list[tuple[str, Any, float]] = {  # kind, size, how far along its axis
            mujoco.mjtGeom.mjGEOM_PLANE: [("plane", (2 * size[0], 2 * size[1], 1.0), 0.0)],
            mujoco.mjtGeom.mjGEOM_BOX: [("box", 2 * size, 0.0)],
            mujoco.mjtGeom.mjGEOM_SPHERE: [("sphere", [2 * radius] * 3, 0.0)],
            mujoco.mjtGeom.mjGEOM_CYLINDER: [("cylinder", (2 * radius, 2 * radius, length), 0.0)],
            mujoco.mjtGeom.mjGEOM_CAPSULE: [
                ("cylinder", (2 * radius, 2 * radius, length), 0.0),
                ("sphere", [2 * radius] * 3, length / 2),
                ("sphere", [2 * radius] * 3, -length / 2),
            ],
        }.get(kind, [])
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), np.asarray(place[1], dtype=float))
        return [
            {
                "kind": name,
                "size": numbers(extent),
                "position": numbers(place[0] + along * axis),
                "wxyz": numbers(place[1]),
                "rgb": rgb_of(model.geom_rgba[geom]),
                "body": body,
                "hold": int(self._robot.face_hold[face]) if face >= 0 else -1,
            }
            for name, extent, along in parts
        ]

    def poses(self, data: mujoco.MjData) -> list[float]:
        """Of the bodies that move: x, y, z, then w, x, y, z, each."""
        return numbers(np.hstack([data.xpos[self.moving], data.xquat[self.moving]]))


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, matrix.ravel())
    return found
