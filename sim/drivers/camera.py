"""The simulated wrist camera: notes where everything is at each due step, and renders only what somebody reads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from grape.messages import Array, CameraInfo, RgbdImage
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.physics import Physics, Replica
from grape.sim.render import Renderer
from grape.sim.sensors.noise import FrameNoise
from grape.sim.sensors.rgbd import Glare, NoiseBank, RgbdModel, measured_color, measured_depth


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
        return self._physics.data.qpos.copy(), self.errors

    def _measure(self, index: int, stamp: float, snapshot: tuple[Array, RgbdModel]) -> RgbdImage:
        import cv2

        qpos, errors = snapshot
        options = self._options
        if self._renderer is None or self._replica is None:
            self._replica = Replica(self._seen())
            self._renderer = Renderer(self._replica.model, options.width, options.height, reach_m=options.reach_m)
        if self._banks is None:
            rng = self._noise.constant()
            gray = NoiseBank(rng, options.height, options.width, 3).scaled(errors.noise)
            self._banks = gray, NoiseBank(rng, options.height, options.width, 1)
        rgb, depth = self._renderer.color_and_depth(self._replica.show(qpos), options.camera)
        rng = self._noise.frame(index)
        return RgbdImage(
            stamp=stamp,
            frame_id=options.frame_id,
            bgr=measured_color(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), self._banks[0].cut(rng), errors),
            depth=measured_depth(depth, self._banks[1].cut(rng)[..., 0], float(self.info.K[0, 0]), errors),
            info=self.info,
        )
