"""Poses in the plane as arrays (..., 3) of x (m), y (m), yaw (rad): `a_T_b` written as `pose_a_b`."""

from __future__ import annotations

import numpy as np

from grape.geometry import wrap_angle
from grape.messages import Array


def compose(pose_a_b: Array, pose_b_c: Array) -> Array:
    """Poses of C in A (..., 3)."""
    a, b = np.asarray(pose_a_b, float), np.asarray(pose_b_c, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        np.broadcast_arrays(
            a[..., 0] + c * b[..., 0] - s * b[..., 1],
            a[..., 1] + s * b[..., 0] + c * b[..., 1],
            wrap_angle(np.asarray(a[..., 2] + b[..., 2])),
        ),
        axis=-1,
    )


def between(pose_a_b: Array, pose_a_c: Array) -> Array:
    """Poses of C in B (..., 3)."""
    a, b = np.asarray(pose_a_b, float), np.asarray(pose_a_c, float)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, c * dy - s * dx, wrap_angle(np.asarray(b[..., 2] - a[..., 2]))], axis=-1)


def transform_points(pose_a_b: Array, points_b: Array) -> Array:
    """Points (n, 2) m given in B, in A."""
    c, s = np.cos(pose_a_b[2]), np.sin(pose_a_b[2])
    return np.asarray(points_b) @ np.array([[c, s], [-s, c]]) + np.asarray(pose_a_b)[:2]


def chained(increments: Array, start: Array | None = None) -> Array:
    """Poses (n + 1, 3) that begin at `start` (3,) (default 0) and follow increments (n, 3), each in the pose before."""
    poses = np.zeros((len(increments) + 1, 3))
    poses[0] = 0.0 if start is None else start
    for k, step in enumerate(np.asarray(increments, float)):
        poses[k + 1] = compose(poses[k], step)
    return poses
