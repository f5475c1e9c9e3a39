"""Pictures of a scene: fast colour and depth for the sensors, and good-looking ones for people.

Rendering runs without a window; the environment variable MUJOCO_GL chooses how (egl where it is not set).
"""

from __future__ import annotations

import os
from dataclasses import dataclass

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array

MAX_WIDTH, MAX_HEIGHT = 1280, 960  # of the offscreen buffer that every composed model gets
_MAX_GEOMS = 20_000


@dataclass(frozen=True, kw_only=True)
class View:
    """A free camera: looks at `target` (3,) m from `distance_m` away; azimuth and elevation in degrees."""

    target: Array
    distance_m: float = 6.0
    azimuth_deg: float = 60.0
    elevation_deg: float = -25.0


class Renderer:
    """Renders scenes of one model at one size; colour and depth come from a single pass.

    Args:
        pretty: shadows, reflections and anti-aliasing for people; without it a sensor's speed.

    Raises:
        InvalidInput: the size exceeds the offscreen buffer.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, *, pretty: bool = False) -> None:
        if not (0 < width <= MAX_WIDTH and 0 < height <= MAX_HEIGHT):
            raise InvalidInput(f"a picture may be at most {MAX_WIDTH} x {MAX_HEIGHT}, got {width} x {height}")
        self._model = model
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._gl = mujoco.GLContext(MAX_WIDTH, MAX_HEIGHT)
        self._gl.make_current()
        quality = model.vis.quality
        saved = quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks
        if not pretty:
            quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = 0, 0, 8, 4
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = saved
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = pretty
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = pretty
        self._option = mujoco.MjvOption()
        self._option.geomgroup[3:] = 0
        self._option.sitegroup[:] = 0
        self._rgb = np.empty((height, width, 3), dtype=np.uint8)
        self._depth = np.empty((height, width), dtype=np.float32)

    def color(self, data: mujoco.MjData, camera: str | View) -> Array:
        """The picture (h, w, 3) RGB uint8 as seen by a camera of the model or a free one."""
        self._draw(data, camera)
        mujoco.mjr_readPixels(self._rgb, None, self._rect, self._context)
        return np.flipud(self._rgb).copy()

    def color_and_depth(self, data: mujoco.MjData, camera: str | View) -> tuple[Array, Array]:
        """RGB (h, w, 3) uint8 and the distance along the optical axis (h, w) float32 in metres."""
        self._draw(data, camera)
        mujoco.mjr_readPixels(self._rgb, self._depth, self._rect, self._context)
        extent = self._model.stat.extent
        near, far = (np.float32(limit * extent) for limit in (self._model.vis.map.znear, self._model.vis.map.zfar))
        # Reversed depth buffer: 1 at the near plane, 0 at the far one.
        depth = near * far / (self._depth * (far - near) + near)
        return np.flipud(self._rgb).copy(), np.flipud(depth).copy()

    def close(self) -> None:
        """Give the graphics memory back."""
        self._context.free()
        self._gl.free()

    def _draw(self, data: mujoco.MjData, camera: str | View) -> None:
        self._gl.make_current()
        category = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera(camera), category, self._scene)
        mujoco.mjr_render(self._rect, self._scene, self._context)

    def _camera(self, camera: str | View) -> mujoco.MjvCamera:
        view = mujoco.MjvCamera()
        if isinstance(camera, View):
            view.type = mujoco.mjtCamera.mjCAMERA_FREE
            view.lookat[:] = camera.target
            view.distance, view.azimuth, view.elevation = camera.distance_m, camera.azimuth_deg, camera.elevation_deg
            return view
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if view.fixedcamid < 0:
            known = [self._model.camera(k).name for k in range(self._model.ncam)]
            raise InvalidInput(f"there is no camera {camera!r}; allowed: {known} or a View")
        return view
