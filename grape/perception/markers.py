"""Square ArUco markers: their corners in an image and their pose from known sizes.

The marker frame has its origin at the centre of the black square, x to the right and y up in the printed image and z
out of the face. Corners are ordered top-left, top-right, bottom-right, bottom-left in the printed image; pixel centres
have whole coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from grape.errors import InvalidInput, with_suggestion
from grape.geometry import is_pose, pose, transform
from grape.messages import Array, frozen_array
from grape.perception.checks import as_intrinsics, as_region
from grape.perception.marker_edges import refine_corners

DICTIONARIES = tuple(sorted(n.removeprefix("DICT_") for n in dir(cv2.aruco) if n.startswith("DICT_")))


@dataclass(frozen=True, kw_only=True)
class MarkerOptions:
    """How corners are found and refined.

    Args:
        window_px: largest half-size of the window of the sub-pixel refinement.
        relative_window: that half-size as a fraction of a marker cell, for small markers.
        iterations, accuracy_px: where the refinement stops.
        threshold: constant of the adaptive threshold (grey levels).
        min_side_px: markers whose mean side is smaller are left out: their pose would mislead.
    """

    window_px: int = 5
    relative_window: float = 0.8
    iterations: int = 30
    accuracy_px: float = 0.01
    threshold: float = 7.0
    min_side_px: float = 10.0

    def __post_init__(self) -> None:
        if self.window_px < 1 or self.iterations < 1 or not 0 < self.relative_window <= 4 or self.accuracy_px <= 0:
            raise InvalidInput(f"marker options must be positive, got {self}")


@dataclass(frozen=True, kw_only=True)
class Marker:
    """One marker seen in an image; `corners` (4, 2) px."""

    id: int
    corners: Array

    def __post_init__(self) -> None:
        corners = np.asarray(self.corners, dtype=np.float64)
        if corners.shape != (4, 2) or not np.isfinite(corners).all():
            raise InvalidInput(f"marker corners must be (4, 2) finite px, got {self.corners}")
        object.__setattr__(self, "corners", frozen_array(corners))

    @property
    def centre(self) -> Array:
        """(2,) px, where the diagonals' ends average."""
        return self.corners.mean(axis=0)

    @property
    def side_px(self) -> float:
        """Mean length of the four sides, px."""
        return float(np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=0), axis=1).mean())


@dataclass(frozen=True, kw_only=True)
class BoardPose:
    """Pose of a rigid set of markers: `T_camera_board`, root mean square error in px, ids that were used."""

    T_camera_board: Array
    error_px: float
    ids: tuple[int, ...]


class MarkerDetector:
    """Finds the markers of one dictionary; holds OpenCV's detector, no state between images.

    Args:
        dictionary: one of `DICTIONARIES`, e.g. "4X4_50".
        options: see `MarkerOptions`.

    Raises:
        InvalidInput: an unknown dictionary.
    """

    def __init__(self, dictionary: str = "4X4_50", options: MarkerOptions | None = None) -> None:
        name = dictionary.upper().removeprefix("DICT_")
        if name not in DICTIONARIES:
            sentence = f"unknown marker dictionary {dictionary!r}; allowed: {', '.join(DICTIONARIES)}"
            raise InvalidInput(with_suggestion(sentence, name, DICTIONARIES))
        self.options = options or MarkerOptions()
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.cornerRefinementWinSize = self.options.window_px
        parameters.relativeCornerRefinmentWinSize = self.options.relative_window
        parameters.cornerRefinementMaxIterations = self.options.iterations
        parameters.cornerRefinementMinAccuracy = self.options.accuracy_px
        parameters.adaptiveThreshConstant = self.options.threshold
        predefined = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
        self._detector = cv2.aruco.ArucoDetector(predefined, parameters)
        self._cells = predefined.markerSize + 2

    def detect(self, image: Array, roi: Any = None) -> tuple[Marker, ...]:
        """The markers in `image`, by rising id.

        Args:
            image: (h, w) grey or (h, w, 3) BGR, uint8.
            roi: (u0, v0, u1, v1) px to search in; corners are still given in the whole image.

        Raises:
            InvalidInput: another shape or type, or a region outside the image.
        """
        grey = _as_grey(image)
        u0, v0, u1, v1 = (0, 0, grey.shape[1], grey.shape[0]) if roi is None else as_region(roi, grey.shape)
        part = np.ascontiguousarray(grey[v0:v1, u0:u1])
        corners, ids, _ = self._detector.detectMarkers(part)
        if ids is None:
            return ()
        found = [
            Marker(id=int(i), corners=refine_corners(part, c.reshape(4, 2), self._cells) + np.array((u0, v0)))
            for i, c in zip(ids.ravel(), corners, strict=True)
        ]
        return tuple(sorted((m for m in found if m.side_px >= self.options.min_side_px), key=lambda m: m.id))


def _as_grey(image: Array) -> Array:
    array = np.asarray(image)
    if array.dtype != np.uint8 or array.size == 0 or not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)):
        raise InvalidInput(f"an image must be (h, w) or (h, w, 3) uint8 and not empty, got {array.shape} {array.dtype}")
    return array if array.ndim == 2 else cv2.cvtColor(array, cv2.COLOR_BGR2GRAY)


def corner_points(side_m: float) -> Array:
    """(4, 3) m, the corners of a marker in its own frame.

    Raises:
        InvalidInput: the side is not positive.
    """
    if not (np.isfinite(side_m) and side_m > 0):
        raise InvalidInput(f"a marker side must be positive metres, got {side_m}")
    h = side_m / 2
    return np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])


def project(points: Array, K: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) m in the optical frame; points must have z > 0."""
    return points[:, :2] / points[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]


def _marker_solutions(corners: Array, side_m: float, K: Array) -> list[Array]:
    """Both planar poses of one marker, better one first."""
    try:
        count, rotations, translations, _ = cv2.solvePnPGeneric(
            corner_points(side_m), corners, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
    except cv2.error as error:
        raise InvalidInput(f"marker corners {corners.tolist()} do not form a square that a camera can see") from error
    poses = [pose(cv2.Rodrigues(r)[0], t.ravel()) for r, t in zip(rotations, translations, strict=True)][:count]
    return [T for T in poses if is_pose(T, 1e-4) and T[2, 3] > 0]


def marker_pose(marker: Marker, side_m: float, K: Array) -> Array:
    """`T_camera_marker` of one marker; of the two planar solutions the one that fits its corners better.

    Args:
        marker: its corners in px.
        side_m: side of the black square.
        K: (3, 3) camera matrix of the undistorted image.

    Raises:
        InvalidInput: sizes that are not positive, or corners that are no image of a square.

    Source: Collins and Bartoli, Infinitesimal plane-based pose estimation, IJCV 2014.
    """
    solutions = _marker_solutions(marker.corners, side_m, as_intrinsics(K))
    if not solutions:
        raise InvalidInput(f"marker {marker.id}: no pose fits corners {marker.corners.tolist()}")
    return solutions[0]


def board_pose(markers: Sequence[Marker], T_board_marker: Mapping[int, Array], side_m: float, K: Array) -> BoardPose:
    """Pose of a rigid set of markers from every corner seen of it; markers that are not of the set are ignored.

    Each marker's two planar solutions start a least-squares refinement over all corners; the best result is kept, so
    that the two-fold ambiguity of one small marker is resolved by the others.

    Args:
        markers: what `MarkerDetector.detect` returned.
        T_board_marker: pose of each marker id in the board frame.
        side_m: side of the black squares.
        K: (3, 3) camera matrix.

    Raises:
        InvalidInput: none of the markers belongs to the set, or no pose fits.
    """
    K = as_intrinsics(K)
    used = [m for m in markers if m.id in T_board_marker]
    if not used:
        seen = [m.id for m in markers]
        raise InvalidInput(f"no marker of the set {sorted(T_board_marker)} among the seen markers {seen}")
    square = corner_points(side_m)
    points = np.vstack([transform(T_board_marker[m.id], square) for m in used])  # (4 n, 3) board
    pixels = np.vstack([m.corners for m in used])  # (4 n, 2)
    starts = [T @ np.linalg.inv(T_board_marker[m.id]) for m in used for T in _marker_solutions(m.corners, side_m, K)]
    refined = [_refine(T, points, pixels, K) for T in starts]
    fits = [(error, k) for k, (_, error) in enumerate(refined) if np.isfinite(error)]
    if not fits:
        raise InvalidInput(f"no pose fits the corners of markers {[m.id for m in used]}")
    error, best = min(fits)
    T = frozen_array(refined[best][0])
    return BoardPose(T_camera_board=T, error_px=error, ids=tuple(m.id for m in used))


def _refine(T: Array, points: Array, pixels: Array, K: Array) -> tuple[Array, float]:
    """Least squares over all corners from a start pose, and the root mean square error in px."""
    rotation, translation = cv2.solvePnPRefineLM(
        points, pixels, K, None, cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].reshape(3, 1).copy()
    )
    T = pose(cv2.Rodrigues(rotation)[0], translation.ravel())
    seen = transform(T, points)
    if not np.isfinite(seen).all() or (seen[:, 2] <= 0).any():
        return T, float("inf")
    return T, float(np.sqrt(np.mean(np.sum((project(seen, K) - pixels) ** 2, axis=1))))
