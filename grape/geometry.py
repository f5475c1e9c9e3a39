"""Rigid-body geometry on plain arrays: 4 x 4 poses `T_A_B`, 3 x 3 rotations `R_A_B`, quaternions wxyz.

Twists and increments are ordered linear first, angular second (v, w), as in Pinocchio.
Source: Lynch and Park, Modern Robotics, 2017, chapter 3.
"""

from __future__ import annotations

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array

_IDENTITY, _HERE = np.eye(3), np.eye(4)  # a copy takes a tenth of the time of another np.eye


def pose(rotation: Array | None = None, translation: Array | tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """The 4 x 4 pose with a 3 x 3 rotation (identity when None) and a translation in metres."""
    T = _HERE.copy()
    if rotation is not None:
        T[:3, :3] = rotation
    T[:3, 3] = translation
    return T


def inverse(T: Array) -> Array:
    """The inverse of a pose: `T_B_A` from `T_A_B`."""
    result = _HERE.copy()
    result[:3, :3] = T[:3, :3].T
    result[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return result


def transform(T_A_B: Array, points_B: Array) -> Array:
    """Points (..., 3) given in B, expressed in A."""
    return points_B @ T_A_B[:3, :3].T + T_A_B[:3, 3]


def skew(v: Array) -> Array:
    """The matrix [v] with [v] x = v cross x."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_exp(w: Array) -> Array:
    """Rotation by the vector `w` (axis times angle, rad): Rodrigues' formula."""
    angle = float(np.linalg.norm(w))
    if angle < 1e-12:
        return np.eye(3) + skew(w)
    K = skew(np.asarray(w) / angle)
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def rotation_log(R: Array) -> Array:
    """The rotation vector (3,) of R, angle in [0, pi]."""
    q = rotation_to_quaternion(R)
    sine = float(np.linalg.norm(q[1:]))
    if sine < 1e-12:
        return 2.0 * q[1:]
    return 2.0 * np.arctan2(sine, q[0]) * q[1:] / sine


def rotation_x(angle: float) -> Array:
    """Rotation about x by `angle` rad."""
    return rotation_exp(np.array([angle, 0.0, 0.0]))


def rotation_y(angle: float) -> Array:
    """Rotation about y by `angle` rad."""
    return rotation_exp(np.array([0.0, angle, 0.0]))


def rotation_z(angle: float) -> Array:
    """Rotation about z by `angle` rad."""
    return rotation_exp(np.array([0.0, 0.0, angle]))


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation Rz(yaw) Ry(pitch) Rx(roll), as URDF and REP-103 have it."""
    return rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def rotation_to_rpy(R: Array) -> Array:
    """(roll, pitch, yaw) of R; at pitch +-90 degrees roll is set to 0."""
    if abs(R[2, 0]) > 1.0 - 1e-12:
        yaw = np.arctan2(-R[0, 1], R[1, 1])
        return np.array([0.0, -np.sign(R[2, 0]) * np.pi / 2, yaw])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])])


def yaw_of(T: Array) -> float:
    """Yaw (rad) of a pose or rotation."""
    return float(np.arctan2(T[1, 0], T[0, 0]))


def quaternion_to_rotation(q: Array) -> Array:
    """Rotation matrix of a quaternion wxyz; it is normalised first.

    Raises:
        InvalidInput: the quaternion is zero or not finite.
    """
    q = np.asarray(q, dtype=float)
    norm = float(np.linalg.norm(q))
    if not np.isfinite(norm) or norm < 1e-9:
        raise InvalidInput(f"a quaternion wxyz must be finite and not zero, got {q}")
    w, x, y, z = q / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_to_quaternion(R: Array) -> Array:
    """Quaternion wxyz with w >= 0 (Shepperd's method)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    diagonal = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    k = int(np.argmax(diagonal))
    q = np.empty(4)
    s = np.sqrt(max(1.0 + 2.0 * diagonal[k] - trace, 0.0))
    q[k] = 0.5 * s
    f = 0.5 / s
    if k == 0:
        q[1:] = f * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    elif k == 1:
        q[0], q[2], q[3] = f * (R[2, 1] - R[1, 2]), f * (R[0, 1] + R[1, 0]), f * (R[0, 2] + R[2, 0])
    elif k == 2:
        q[0], q[1], q[3] = f * (R[0, 2] - R[2, 0]), f * (R[0, 1] + R[1, 0]), f * (R[1, 2] + R[2, 1])
    else:
        q[0], q[1], q[2] = f * (R[1, 0] - R[0, 1]), f * (R[0, 2] + R[2, 0]), f * (R[1, 2] + R[2, 1])
    return q if q[0] >= 0 else -q


def pose_error(T_A_target: Array, T_A_current: Array) -> Array:
    """(6,) difference target minus current in A: translation (m), then rotation vector (rad)."""
    return np.concatenate(
        [
            T_A_target[:3, 3] - T_A_current[:3, 3],
            rotation_log(T_A_target[:3, :3] @ T_A_current[:3, :3].T),
        ]
    )


def interpolate(T_A_B: Array, T_A_C: Array, s: float) -> Array:
    """The pose a fraction `s` of the way from B to C: straight line and constant rotation axis."""
    return interpolate_many(T_A_B, T_A_C, np.array([s]))[0]


def interpolate_many(T_A_B: Array, T_A_C: Array, s: Array) -> Array:
    """Poses (n, 4, 4), each a fraction `s` (n,) of the way from B to C, as `interpolate` gives them."""
    R = T_A_B[:3, :3]
    w = rotation_log(R.T @ T_A_C[:3, :3])
    angle = float(np.linalg.norm(w))
    K = skew(w / max(angle, 1e-12))
    turned = s[:, None, None] * angle
    T = np.zeros((len(s), 4, 4))
    T[:, :3, :3] = R + np.sin(turned) * (R @ K) + (1.0 - np.cos(turned)) * (R @ K @ K)
    T[:, :3, 3] = T_A_B[:3, 3] + s[:, None] * (T_A_C[:3, 3] - T_A_B[:3, 3])
    T[:, 3, 3] = 1.0
    return T


def wrap_angle(angle: Array | float) -> Array | float:
    """The angle in (-pi, pi]."""
    wrapped = -((-np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)
    return float(wrapped) if np.ndim(angle) == 0 else wrapped


def is_pose(T: Array, tolerance: float = 1e-6) -> bool:
    """Whether T is a finite 4 x 4 matrix with a proper rotation and a last row 0 0 0 1."""
    T = np.asarray(T)
    if T.shape != (4, 4) or max(abs(T[3, 0]), abs(T[3, 1]), abs(T[3, 2]), abs(T[3, 3] - 1.0)) > tolerance:
        return False
    if not np.isfinite(T[:3, 3]).all():
        return False
    R = T[:3, :3]
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return bool(np.abs(R @ R.T - _IDENTITY).max() <= tolerance and determinant > 0)
