"""Pictures of a scene: fast colour and depth for the sensors, and good-looking ones for people.

Rendering runs without a window; the environment variable MUJOCO_GL chooses how (egl where it is not set).
"""

from __future__ import annotations

import os
import weakref
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array

MAX_WIDTH, MAX_HEIGHT = 1280, 960  # of the offscreen buffer that every composed model gets
SHOWN_GROUPS = (0, 1, 2)  # groups above are collision shapes
_HIDDEN_GROUP = 5
_MAX_GEOMS = 20_000
_SHADOW_REACH_M = 12.0
_UNBOUNDED = (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_PLANE)


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
        pretty: shadows and anti-aliasing for people; without it a sensor's speed.
        reach_m: things farther than this from a camera of the model, or outside its picture, are left out (ground and
            sky never are); None draws all.

    Raises:
        InvalidInput: the size exceeds the offscreen buffer.
    """

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, *, pretty: bool = False, reach_m: float | None = None
    ) -> None:
        if not (0 < width <= MAX_WIDTH and 0 < height <= MAX_HEIGHT):
            raise InvalidInput(f"a picture may be at most {MAX_WIDTH} x {MAX_HEIGHT}, got {width} x {height}")
        self._model = model
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._aspect = width / height
        self._pretty = pretty
        self._reach_m = reach_m
        self._gl = _gl_context()
        self._gl.make_current()
        if pretty:
            _cast_shadows(model)
        self._context = _make_context(model, pretty)
        self._release = weakref.finalize(self, _free, self._gl, self._context)
        self._release.atexit = False  # MuJoCo ends the display by itself, maybe before
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = pretty
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = pretty  # a third of a sensor frame's time; painted instead
        self._sky = None if pretty else _sky_ramp(model)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [group in SHOWN_GROUPS for group in range(len(self._option.geomgroup))]
        self._option.sitegroup[:] = 0
        bounded = ~np.isin(model.geom_type, _UNBOUNDED)
        self._small = np.flatnonzero(bounded & np.isin(model.geom_group, SHOWN_GROUPS))
        self._groups = model.geom_group[self._small].copy()
        self._rgb = np.empty((height, width, 3), dtype=np.uint8)
        self._depth = np.empty((height, width), dtype=np.float32)

    def color(self, data: mujoco.MjData, camera: str | View) -> Array:
        """The picture (h, w, 3) RGB uint8 as seen by a camera of the model or a free one."""
        self._draw(data, camera)
        mujoco.mjr_readPixels(self._rgb, None, self._rect, self._context)
        return np.flipud(self._rgb).copy()

    def color_and_depth(self, data: mujoco.MjData, camera: str | View) -> tuple[Array, Array]:
        """RGB (h, w, 3) uint8 and the distance along the optical axis (h, w) float32 in metres."""
        import cv2

        self._draw(data, camera)
        mujoco.mjr_readPixels(self._rgb, self._depth, self._rect, self._context)
        if self._sky is not None and (background := self._depth == 0.0).any():
            self._paint_sky(self._sky, background)
        extent = self._model.stat.extent
        near, far = (np.float32(limit * extent) for limit in (self._model.vis.map.znear, self._model.vis.map.zfar))
        # Reversed depth buffer: 1 at the near plane, 0 at the far one.
        depth = near * far / (self._depth * (far - near) + near)
        return cv2.flip(self._rgb, 0), cv2.flip(depth, 0)

    def _paint_sky(self, ramp: Array, background: Array) -> None:
        """Fill the (h, w) `background` of the upside-down colour picture with the sky's gradient."""
        import cv2

        height, width = background.shape
        camera = self._scene.camera[0]
        forward, up = np.array(camera.forward, dtype=float), np.array(camera.up, dtype=float)
        slope = (camera.frustum_top - camera.frustum_bottom) / (2.0 * camera.frustum_near)
        v, u = np.mgrid[-1:1:60j, -1:1:80j]  # bottom to top, left to right
        rays = forward + slope * (v[..., None] * up + u[..., None] * self._aspect * np.cross(forward, up))
        # As on the side of a sky cube: what counts is the height over the larger horizontal component.
        climb = rays[..., 2] / np.maximum(np.abs(rays[..., :2]).max(axis=-1), 1e-6)
        index = np.clip(0.5 * (1.0 - climb), 0.0, 1.0) * (len(ramp) - 1)
        small = ramp[np.rint(index).astype(int)]
        cv2.copyTo(cv2.resize(small, (width, height)), background.astype(np.uint8), self._rgb)

    def close(self) -> None:
        """Give the graphics memory back, as happens to a renderer that is dropped."""
        self._release()

    def _draw(self, data: mujoco.MjData, camera: str | View) -> None:
        self._gl.make_current()
        view = self._camera(camera)
        if self._reach_m is not None and view.type == mujoco.mjtCamera.mjCAMERA_FIXED:
            self._model.geom_group[self._small] = np.where(
                self._in_reach(data, view.fixedcamid), self._groups, _HIDDEN_GROUP
            )
        if self._pretty:
            # The shadow map reaches _SHADOW_REACH_M around the light's position, which a sun does not have.
            data.light_xpos[:] = view.lookat - 10.0 * data.light_xdir
        category = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._option, None, view, category, self._scene)
        mujoco.mjr_render(self._rect, self._scene, self._context)

    def _in_reach(self, data: mujoco.MjData, camera: int) -> Array:
        """Which of the bounded geoms are near the camera and in a cone around its picture."""
        offset = data.geom_xpos[self._small] - data.cam_xpos[camera]
        ahead = -(offset @ data.cam_xmat[camera].reshape(3, 3)[:, 2])
        distance = np.linalg.norm(offset, axis=1)
        beside = np.sqrt(np.maximum(distance**2 - ahead**2, 0.0))
        half_diagonal = np.tan(0.5 * np.radians(self._model.cam_fovy[camera])) * np.hypot(1.0, self._aspect)
        margin = self._model.geom_rbound[self._small] * np.hypot(1.0, half_diagonal)
        return (beside <= half_diagonal * ahead + margin) & (distance <= self._reach_m + margin)

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


def _gl_context() -> Any:
    """An off-screen context of the kind that MUJOCO_GL names; EGL, which needs no display, where it names none."""
    if os.environ.get("MUJOCO_GL", "egl").lower() == "egl":
        from mujoco.egl import GLContext

        return GLContext(MAX_WIDTH, MAX_HEIGHT)
    return mujoco.GLContext(MAX_WIDTH, MAX_HEIGHT)


def _free(gl: Any, context: mujoco.MjrContext) -> None:
    """Free a context's objects where they are: by numbers, which mean another renderer's objects in its context."""
    with gl.as_current():
        context.free()
    gl.free()


def _make_context(model: mujoco.MjModel, pretty: bool) -> mujoco.MjrContext:
    quality = model.vis.quality
    saved = quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks
    quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = (
        (4, 4096, 24, 12) if pretty else (0, 0, 8, 4)
    )
    clip, model.vis.map.shadowclip = model.vis.map.shadowclip, _SHADOW_REACH_M / model.stat.extent
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = saved
    model.vis.map.shadowclip = clip
    return context


def _cast_shadows(model: mujoco.MjModel) -> None:
    """Let the sun cast shadows, and move its ambient share to the headlight, which alone reaches into them."""
    if not model.nlight or model.light_castshadow.all():
        return
    model.light_castshadow[:] = True
    headlight = model.vis.headlight
    headlight.active = 1
    headlight.ambient[:] = model.light_ambient.sum(axis=0)
    headlight.diffuse[:] = headlight.specular[:] = 0.0
    model.light_ambient[:] = 0.0


def _sky_ramp(model: mujoco.MjModel) -> Array | None:
    """Colours (n, 3) uint8 of the sky box's side from 45 degrees above the horizon to 45 degrees below it."""
    skies = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    if not skies.size:
        return None
    sky = skies[0]
    width, channels, start = model.tex_width[sky], model.tex_nchannel[sky], model.tex_adr[sky]
    faces = model.tex_data[start : start + width * model.tex_height[sky] * channels].reshape(-1, width, channels)
    front = faces[4 * width : 5 * width] if len(faces) >= 6 * width else faces  # right, left, up, down, front, back
    return front[:, width // 2, :3].copy()
