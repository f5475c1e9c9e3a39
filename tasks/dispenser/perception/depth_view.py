"""What one depth frame could have shown: whether a piece of a vine lies in its picture, and in front of everything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.geometry import inverse, transform
from grape.messages import Array, RgbdImage
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose

_SAMPLES = 7


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthView:
    """A depth frame and where it was taken.

    Args:
        image: the frame.
        T_base_camera: (4, 4) pose of its optical frame in the frame of the deployment poses.
        margin_px: what lies nearer to the picture's edge may be cut off by it.
        behind_m: something this much nearer to the camera hides what is behind.
        nearest_m: nearer than this the camera measures no depth.
    """

    image: RgbdImage
    T_base_camera: Array
    margin_px: float = 14.0
    behind_m: float = 0.03
    nearest_m: float = 0.22

    def inside(self, pose: DeploymentPose) -> bool:
        """Whether the whole spur lies in the picture, clear of its edges."""
        u, v, z = self._project(pose)
        h, w = self.image.depth.shape
        m = self.margin_px
        return bool(((z > 0) & (u > m) & (u < w - 1 - m) & (v > m) & (v < h - 1 - m)).all())

    def shows(self, pose: DeploymentPose) -> float:
        """How sure the frame should have shown a spur: 1 in plain view, 0.5 behind something, 0 out of it."""
        if not self.inside(pose):
            return 0.0
        u, v, z = self._project(pose)
        depth = np.asarray(self.image.depth)[np.rint(v).astype(int), np.rint(u).astype(int)]
        open_way = (depth > 0) & (depth > z - self.behind_m)
        return 1.0 if int(open_way.sum()) >= _SAMPLES - 1 else 0.5

    def looked_at(self, points: Array) -> Array:
        """Which points (n, 3) lie in the picture and not behind something, (n,) bool. No depth means nothing there."""
        u, v, z = self._pixels(points)
        h, w = self.image.depth.shape
        inside = (z > self.nearest_m) & (u > 0) & (u < w - 1) & (v > 0) & (v < h - 1)
        depth = np.asarray(self.image.depth)[
            np.rint(np.where(inside, v, 0.0)).astype(int), np.rint(np.where(inside, u, 0.0)).astype(int)
        ]
        return inside & ((depth == 0) | (depth > z - self.behind_m))

    def _project(self, pose: DeploymentPose) -> tuple[Array, Array, Array]:
        return self._pixels(pose.base + np.linspace(0.0, 1.0, _SAMPLES)[:, None] * (pose.tip - pose.base))

    def _pixels(self, points: Array) -> tuple[Array, Array, Array]:
        """Column and row (n,) px, and depth (n,) m, of points (n, 3)."""
        p = transform(inverse(self.T_base_camera), points)
        K = self.image.info.K
        z = np.maximum(p[:, 2], 1e-6)
        return K[0, 0] * p[:, 0] / z + K[0, 2], K[1, 1] * p[:, 1] / z + K[1, 2], p[:, 2]
