"""What a camera on paper sees: markers, red wings and rods, drawn into a colour and a depth image."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from grape.geometry import inverse, transform
from grape.messages import CameraInfo
from grape.perception.markers import project
from grape.robots.husky_jaco2 import DESCRIPTION

K = np.array([[466.0, 0.0, 319.5], [0.0, 466.0, 239.5], [0.0, 0.0, 1.0]])
INFO = CameraInfo(stamp=0.0, width=640, height=480, K=K)
RED, WOOD, SOIL = (13, 13, 217), (53, 92, 133), (110, 125, 130)  # BGR
BEHIND_M = 1.5  # depth of what is behind everything that is drawn


@dataclass
class Scene:
    """What the camera sees, in base_link: markers, red wings (flat, facing up), rods; wings at the nails when held.

    Attributes:
        askew: where a wing of a loop is that hangs from one nail, in the frame of the nails.
    """

    markers: dict[int, Any] = field(default_factory=dict)
    wings: list[Any] = field(default_factory=list)
    rods: list[tuple[Any, Any, float]] = field(default_factory=list)
    held: bool = False
    askew: Any = None

    def draw(self, T_base_hand: Any, finger_angle: float, hand: Any) -> tuple[Any, Any]:
        """Colour (h, w, 3) and depth (h, w) from a hand pose."""
        T_camera_base = inverse(T_base_hand @ DESCRIPTION.mounts["camera_optical"].T_parent_sensor)
        bgr = np.full((INFO.height, INFO.width, 3), SOIL, np.uint8)
        depth = np.full((INFO.height, INFO.width), BEHIND_M, np.float32)
        for id, T_base_marker in self.markers.items():
            draw_marker(bgr, depth, id, T_camera_base @ T_base_marker)
        for p0, p1, radius in self.rods:
            draw_rod(bgr, depth, transform(T_camera_base, np.array([p0, p1])), radius)
        wings = list(self.wings)
        nails = T_base_hand @ hand.T_hand_nails(finger_angle)
        if self.askew is not None:
            wings.append(transform(nails, np.asarray(self.askew)))
        if self.held:
            wings += [transform(nails, np.array([side * 0.032, 0.0, 0.0])) for side in (-1.0, 1.0)]
        for wing in wings:
            draw_wing(bgr, depth, transform(T_camera_base, wing))
        return bgr, depth


def draw_marker(bgr: Any, depth: Any, id: int, T_camera_marker: Any, side: float = 0.040, cell: int = 16) -> None:
    """A marker with a white margin of a quarter of its side."""
    if T_camera_marker[2, 3] < 0.05 or T_camera_marker[2, 2] > -0.1:
        return
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    print_ = cv2.aruco.generateImageMarker(dictionary, id, 6 * cell)
    print_ = cv2.copyMakeBorder(print_, *[3 * cell // 2] * 4, cv2.BORDER_CONSTANT, value=255)
    half = 0.75 * side
    plate = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    seen = transform(T_camera_marker, plate)
    if (seen[:, 2] < 0.05).any():
        return
    n = len(print_)
    edges = np.array([[0, 0], [n, 0], [n, n], [0, n]], np.float32) - 0.5
    H = cv2.getPerspectiveTransform(edges, project(seen, K).astype(np.float32))
    size = (bgr.shape[1], bgr.shape[0])
    cover = cv2.warpPerspective(np.full_like(print_, 255), H, size) > 127
    bgr[cover] = cv2.warpPerspective(cv2.merge([print_] * 3), H, size, borderMode=cv2.BORDER_REPLICATE)[cover]
    depth[cover] = T_camera_marker[2, 3]


def draw_wing(bgr: Any, depth: Any, place: Any, half: tuple[float, float] = (0.005, 0.006)) -> None:
    """A red patch that faces the camera at a place (3,) m of the optical frame."""
    if place[2] < 0.05:
        return
    corners = place + np.array([[x * half[0], y * half[1], 0.0] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    _fill(bgr, depth, project(corners, K), RED, place[2])


def draw_rod(bgr: Any, depth: Any, ends: Any, radius: float) -> None:
    """A wooden rod between two places (2, 3) m of the optical frame."""
    if (ends[:, 2] < 0.05).any():
        return
    for s in np.linspace(0.0, 1.0, 60):
        place = (1 - s) * ends[0] + s * ends[1]
        u, v = project(place[None], K)[0]
        mask = np.zeros(depth.shape, np.uint8)
        cv2.circle(mask, (round(u), round(v)), max(1, round(radius * K[0, 0] / place[2])), 1, -1)
        bgr[mask > 0], depth[mask > 0] = WOOD, place[2]


def _fill(bgr: Any, depth: Any, polygon: Any, colour: tuple[int, int, int], z: float) -> None:
    mask = np.zeros(depth.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(polygon).astype(np.int32), 1)
    bgr[mask > 0], depth[mask > 0] = colour, z
