"""Pictures of the robot on the wall, rendered off screen by MuJoCo (EGL; software rendering is enough)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from crux_tools.report.renderer import Renderer
from crux_tools.robot3d.robot_model import RobotModel, build_model
from crux_tools.robot3d.start_pose import RobotPose, take_pose
from crux_tools.robot3d.wall import WALL
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.actuators import joints_rad
from crux_tools.telemetry.description import robot_of

# Seen from the body, frame W: from the lower right, off the wall.
EYE_W_M = np.array([-0.86, -0.56, 1.00])
LOOK_AHEAD_W_M = np.array([-0.01, 0.0, -0.10])
FIELD_OF_VIEW_DEG = 40.0
SUN = "sun"
SUN_ABOVE_BODY_M = np.array([1.1, 0.35, 1.9])
SUPERSAMPLING = 2
JPEG_QUALITY = 86
WALL_RGB = ((0.80, 0.79, 0.74), (0.73, 0.72, 0.67))
WALL_SQUARE_M = 0.2
SKY_RGB = ((0.93, 0.96, 1.0), (0.62, 0.74, 0.90))


@dataclass(frozen=True)
class Picture:
    """A JPEG with its caption."""

    jpeg: bytes
    caption: str


def add_scenery(spec: mujoco.MjSpec) -> None:
    """Sky, lights and a chequered wall, for the eye only."""
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=SKY_RGB[0], rgb2=SKY_RGB[1], width=256, height=256,
    )  # fmt: skip
    spec.add_texture(
        name="chequers", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=WALL_RGB[0], rgb2=WALL_RGB[1], width=256, height=256,
    )  # fmt: skip
    material = spec.add_material(name="chequers", texrepeat=[0.5 / WALL_SQUARE_M] * 2, texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "chequers"
    for surface in (geom for geom in spec.worldbody.geoms if geom.name.startswith(WALL)):
        surface.material, surface.rgba = "chequers", [1, 1, 1, 1]
    spec.worldbody.add_light(
        name=SUN, type=mujoco.mjtLightType.mjLIGHT_SPOT, dir=(-SUN_ABOVE_BODY_M).tolist(), diffuse=[0.5] * 3,
        specular=[0.1] * 3, cutoff=60, exponent=1, attenuation=[1, 0, 0],
    )  # fmt: skip
    spec.visual.headlight.ambient = [0.32] * 3
    spec.visual.headlight.diffuse = [0.28] * 3
    spec.visual.headlight.specular = [0.05] * 3
    spec.visual.quality.shadowsize = 4096
    spec.visual.map.znear = 0.02


class Stage:
    """The robot on its wall, ready to be posed and rendered; use `open_stage`."""

    def __init__(self, robot: RobotModel, renderer: Renderer, size_px: tuple[int, int]) -> None:
        self.robot = robot
        self.data = mujoco.MjData(robot.model)
        self._renderer = renderer
        self._size_px = size_px

    def show_pose(self, pose: RobotPose) -> None:
        """Poses the robot by inverse kinematics; a limb out of reach stays where its solution ended."""
        take_pose(self.robot, self.data, pose)

    def show_cycle(self, log: Telemetry, row: int) -> None:
        """Poses the robot as it was measured in one control cycle."""
        place_measured(self.robot, self.data, log, row)

    def image(self) -> Image.Image:
        """Renders what is shown, the body in the middle, gravity downwards."""
        model = self.robot.model
        model.light_pos[model.light(SUN).id] = self.data.qpos[:3] + SUN_ABOVE_BODY_M
        mujoco.mj_forward(model, self.data)
        body = self.data.xpos[self.robot.body]
        pixels = self._renderer.render(self.data, body + EYE_W_M, body + LOOK_AHEAD_W_M, -model.opt.gravity)
        picture = Image.fromarray(pixels)
        return picture.resize(self._size_px, Image.Resampling.LANCZOS)

    def picture(self, caption: str) -> Picture:
        """Renders what is shown as JPEG."""
        buffer = io.BytesIO()
        self.image().save(buffer, format="JPEG", quality=JPEG_QUALITY)
        return Picture(buffer.getvalue(), caption)


def place_measured(robot: RobotModel, data: mujoco.MjData, log: Telemetry, row: int) -> None:
    """Body as the runtime estimated it, joints and fingers as measured, of one row of a log."""
    data.qpos[:3] = log.state["body_position_w_m"][row]
    data.qpos[3:7] = log.state["body_quaternion_w"][row]
    data.qpos[robot.joint_qpos] = joints_rad(robot.robot, log.inputs["joint_position_rad"][row])
    data.qpos[robot.finger_qpos] = log.inputs["finger_opening_m"][row][:, None]


@contextmanager
def open_stage(plan: Any, size_px: tuple[int, int], robot_files: dict[str, bytes]) -> Iterator[Stage]:
    """A stage with the wall of `plan` and its robot, as `robot_files` of a log describe it where there are some.

    Raises NoGraphicsError where nothing can be rendered.
    """
    width, height = (SUPERSAMPLING * side for side in size_px)

    def prepare(spec: mujoco.MjSpec) -> None:
        add_scenery(spec)
        spec.visual.global_.fovy = FIELD_OF_VIEW_DEG

    with robot_of(plan.robot_name, robot_files) as described:
        robot = build_model(described, plan, prepare)
    renderer = Renderer(robot.model, width, height)
    try:
        yield Stage(robot, renderer, size_px)
    finally:
        renderer.close()
