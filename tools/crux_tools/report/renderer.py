"""Renders a MuJoCo model off screen over EGL, whatever MUJOCO_GL and DISPLAY say: no window, no graphics card."""

from __future__ import annotations

import mujoco
import numpy as np

MAX_GEOMS = 2000
LIBRARIES = "apt-get install libegl1 libopengl0 libegl-mesa0 libgl1-mesa-dri"


class NoGraphicsError(Exception):
    """This machine cannot render; the argument says why, the message also what to do."""

    def __str__(self) -> str:
        return f"this machine has no OpenGL to render with ({super().__str__()}); on Debian: {LIBRARIES}"


class Renderer:
    """One off-screen buffer of width x height pixels; close it after use."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self._model = model
        self.scene = mujoco.MjvScene(model=model, maxgeom=MAX_GEOMS)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        try:
            from mujoco.egl import GLContext

            self._window = GLContext(width, height)
            self._window.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except Exception as error:  # each GL library fails in its own way, also at its import
            raise NoGraphicsError(f"{type(error).__name__}: {error}") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def render(self, data: mujoco.MjData, eye_m: np.ndarray, look_at_m: np.ndarray, up: np.ndarray) -> np.ndarray:
        """Pixels (height, width, 3), uint8, seen from `eye_m` towards `look_at_m` with `up` upwards."""
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        option = mujoco.MjvOption()
        option.sitegroup[:] = 0  # sensor frames are nothing to look at
        mujoco.mjv_updateScene(self._model, data, option, None, mujoco.MjvCamera(), everything, self.scene)
        forward = (look_at_m - eye_m) / np.linalg.norm(look_at_m - eye_m)
        upright = up - forward * (up @ forward)
        for camera in self.scene.camera:
            camera.pos, camera.forward, camera.up = eye_m, forward, upright / np.linalg.norm(upright)
        self._window.make_current()
        mujoco.mjr_render(self._rectangle, self.scene, self._context)
        pixels = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rectangle, self._context)
        return np.flipud(pixels)

    def close(self) -> None:
        """Frees buffers and context."""
        self._context.free()
        self._window.free()
