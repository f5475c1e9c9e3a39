"""How far a trajectory is from a reference, as it is and after the best rigid fit.

Source: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012 (absolute error); Kuemmerle et
al., On measuring the accuracy of SLAM algorithms, Autonomous Robots 2009 (relations between poses).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.mapping.planar import between, compose
from grape.messages import Array


@dataclass(frozen=True, kw_only=True)
class TrajectoryError:
    """Errors in m and rad. `fit` (3,) is the pose of the estimate's frame in the reference's that was used."""

    position_rmse: float
    position_median: float
    position_max: float
    yaw_rmse: float
    fit: Array


@dataclass(frozen=True, kw_only=True)
class RelationError:
    """Mean errors of the relations between poses some way apart: m and rad, and how many relations there were."""

    translation: float
    translation_std: float
    rotation: float
    rotation_std: float
    relations: int


def rigid_fit(estimate: Array, reference: Array) -> Array:
    """The pose (3,) x y yaw that moves points (n, 2) of the estimate best onto those of the reference.

    Source: Umeyama, Least-squares estimation of transformation parameters, PAMI 1991, without scale.
    """
    p, q = np.asarray(estimate)[:, :2], np.asarray(reference)[:, :2]
    pc, qc = p - p.mean(axis=0), q - q.mean(axis=0)
    yaw = np.arctan2((pc[:, 0] * qc[:, 1] - pc[:, 1] * qc[:, 0]).sum(), (pc * qc).sum())
    c, s = np.cos(yaw), np.sin(yaw)
    shift = q.mean(axis=0) - np.array([[c, -s], [s, c]]) @ p.mean(axis=0)
    return np.array([*shift, yaw])


def trajectory_error(estimate: Array, reference: Array, fit: bool = True) -> TrajectoryError:
    """Error of poses (n, 3) against reference poses (n, 3) at the same times; `fit` aligns them first."""
    estimate, reference = _checked(estimate, reference)
    frame = rigid_fit(estimate, reference) if fit else np.zeros(3)
    moved = compose(frame, estimate)
    distance = np.hypot(*(moved[:, :2] - reference[:, :2]).T)
    turn = wrap_angle(moved[:, 2] - reference[:, 2])
    return TrajectoryError(
        position_rmse=float(np.sqrt((distance**2).mean())),
        position_median=float(np.median(distance)),
        position_max=float(distance.max()),
        yaw_rmse=float(np.sqrt((np.asarray(turn) ** 2).mean())),
        fit=frame,
    )


def relation_error(estimate: Array, reference: Array, apart: int = 1) -> RelationError:
    """Error of the relations between each pose and the one `apart` poses later; ways are (n, 3) x y yaw.

    Raises:
        InvalidInput: the ways are not two equal (n, 3) of finite numbers, or too short.
    """
    estimate, reference = _checked(estimate, reference)
    if not 1 <= apart < len(estimate):
        raise InvalidInput(f"apart must be 1 to {len(estimate) - 1}, got {apart}")
    off = between(between(reference[:-apart], reference[apart:]), between(estimate[:-apart], estimate[apart:]))
    shift, turn = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
    return RelationError(
        translation=float(shift.mean()),
        translation_std=float(shift.std()),
        rotation=float(turn.mean()),
        rotation_std=float(turn.std()),
        relations=len(off),
    )


def _checked(estimate: Array, reference: Array) -> tuple[Array, Array]:
    estimate, reference = np.asarray(estimate, float), np.asarray(reference, float)
    if estimate.shape != reference.shape or estimate.ndim != 2 or estimate.shape[1] != 3 or len(estimate) < 2:
        raise InvalidInput(f"two equal arrays (n, 3), n > 1, needed; got {estimate.shape} and {reference.shape}")
    if not (np.isfinite(estimate).all() and np.isfinite(reference).all()):
        raise InvalidInput("poses must be finite")
    return estimate, reference
