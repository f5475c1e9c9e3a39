"""The simulated wrist camera: notes where everything is at each due step, and renders only what somebody reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from grape.messages import Array, CameraInfo, RgbdImage
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import Physics, Replica
from grape.sim.render import SHOWN_GROUPS, Renderer
from grape.sim.sensors.noise import FrameNoise
from grape.sim.sensors.rgbd import (
    Glare,
    GlossyPlate,
    NoiseBank,
    RgbdModel,
    measured_color,
    measured_depth,
    sun_on_plate,
)


@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """Which camera of the model it is, its picture and its errors. The focal length comes from the model's fovy."""

    camera: str = "wrist_camera"
    frame_id: str = "camera_optical"
    width: int = 640
    height: int = 480
    period_s: float = 0.066
    latency_s: float = 0.066
    reach_m: float = 4.5  # how far the world's rods and plates are drawn; ground and sky always are
    gloss_rad: float = 0.0  # how far from the sun's mirror image markers still blind the camera; 0: they are matt
    errors: RgbdModel = field(default_factory=RgbdModel)


class SimulatedCamera(SampledSensor[RgbdImage]):
    """An RGB-D camera whose depth is registered to its colour picture.

    Args:
        seen: makes the model that is rendered, of which any state of `physics` is a state, when it is first needed.
    """

    def __init__(self, physics: Physics, seen: Callable[[], mujoco.MjModel], seed: int, options: CameraOptions) -> None:
        super().__init__(physics, "camera", options.period_s, options.latency_s)
        self.errors = options.errors
        self._options = options
        self._seen = seen
        self._replica: Replica | None = None
        self._noise = FrameNoise(seed, "camera")
        self._renderer: Renderer | None = None
        self._banks: tuple[NoiseBank, NoiseBank] | None = None
        self._markers: list[int] = []  # geoms that may mirror the sun
        fovy = np.radians(physics.model.cam_fovy[physics.identify("camera", options.camera)])
        focal = 0.5 * options.height / np.tan(0.5 * fovy)
        centre = (0.5 * (options.width - 1), 0.5 * (options.height - 1))
        K = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
        self.info = CameraInfo(stamp=0.0, frame_id=options.frame_id, width=options.width, height=options.height, K=K)

    def since(self, stamp: float) -> tuple[RgbdImage, ...]:
        """The newest frame if it is newer than `stamp`; older ones are not rendered."""
        slots = [slot for slot in self._readable() if slot.stamp > stamp + 1e-9]
        return (self._message(slots[-1]),) if slots else ()

    def set_glare(self, glare: Glare | None) -> None:
        """From the next frame on, a saturated disc covers part of the picture."""
        self.errors = replace(self.errors, glare=glare)

    def close(self) -> None:
        """Give the graphics memory back."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _snapshot(self) -> tuple[Array, RgbdModel]:
        return self._physics.snapshot(), self.errors

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, RgbdModel]) -> RgbdImage:
        import cv2

        shown, errors = snapshot
        options = self._options
        if self._renderer is None or self._replica is None:
            self._replica = Replica(self._seen())
            self._renderer = Renderer(self._replica.model, options.width, options.height, reach_m=options.reach_m)
            self._markers = _marker_geoms(self._replica.model) if options.gloss_rad > 0.0 else []
        if self._banks is None:
            rng = self._noise.constant()
            gray = NoiseBank(rng, options.height, options.width, 3).scaled(errors.noise)
            self._banks = gray, NoiseBank(rng, options.height, options.width, 1)
        data = self._replica.show(shown)
        rgb, depth = self._renderer.color_and_depth(data, options.camera)
        saturated = self._mirrored_sun(self._replica.model, data, depth)
        rng = self._noise.frame(index)
        return RgbdImage(
            stamp=stamp,
            frame_id=options.frame_id,
            bgr=measured_color(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), self._banks[0].cut(rng), errors, saturated),
            depth=measured_depth(depth, self._banks[1].cut(rng)[..., 0], float(self.info.K[0, 0]), errors, saturated),
            info=self.info,
        )

    def _mirrored_sun(self, model: mujoco.MjModel, data: mujoco.MjData, depth: Array) -> Array | None:
        """Pixels (n, 2) that glare on the markers saturates; a marker in shadow has none."""
        camera = self._physics.identify("camera", self._options.camera)
        R_camera_map = (data.cam_xmat[camera].reshape(3, 3) * [1.0, -1.0, -1.0]).T  # optical axes: y down, z forward
        towards_sun = -data.light_xdir[0]
        found = []
        for geom in self._markers:
            R_map_plate = data.geom_xmat[geom].reshape(3, 3)
            face = data.geom_xpos[geom] + model.geom_size[geom][2] * R_map_plate[:, 2]
            T = np.eye(4)
            T[:3, :3] = R_camera_map @ R_map_plate
            T[:3, 3] = R_camera_map @ (face - data.cam_xpos[camera])
            plate = GlossyPlate(
                T_camera_plate=T, half_size=model.geom_size[geom][:2], gloss_rad=self._options.gloss_rad
            )
            pixels = sun_on_plate(plate, R_camera_map @ towards_sun, self.info.K, depth)
            if pixels is not None and not _shaded(model, data, face + 1e-3 * R_map_plate[:, 2], towards_sun):
                found.append(pixels)
        return np.concatenate(found) if found else None


def _marker_geoms(model: mujoco.MjModel) -> list[int]:
    """Indices of the geoms that are markers, by their names."""
    names = (model.geom(k).name for k in range(model.ngeom))
    return [k for k, name in enumerate(names) if name.rpartition("/")[2].startswith("marker")]


def _shaded(model: mujoco.MjModel, data: mujoco.MjData, point: Array, towards_sun: Array) -> bool:
    """Whether something that is drawn stands between a point (3,) and the sun."""
    shown = np.array([group in SHOWN_GROUPS for group in range(6)], dtype=np.uint8)
    hit = np.zeros(1, dtype=np.int32)
    return bool(mujoco.mj_ray(model, data, point, towards_sun, shown, 1, -1, hit, None) >= 0.0)
