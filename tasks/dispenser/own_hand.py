"""What of a depth frame is the robot's own hand."""

from __future__ import annotations

import numpy as np

from grape.geometry import transform
from grape.messages import Array
from grape.perception.cloud import crop_mask

OWN_HAND = (np.array([-0.13, -0.13, -0.30]), np.array([0.13, 0.13, 0.10]))  # m, corners in the hand's frame
OWN_LOOP = (np.array([-0.07, -0.20, -0.33]), np.array([0.07, 0.05, -0.20]))  # of a held dispenser, too


def without_hand(points: Array, T_hand_camera: Array, holding: bool) -> Array:
    """Points (n, 3) m of the optical frame that are neither hand and fingers nor, while `holding`, a dispenser."""
    in_hand = transform(T_hand_camera, points)
    own = crop_mask(in_hand, *OWN_HAND)
    if holding:
        own |= crop_mask(in_hand, *OWN_LOOP)
    return points[~own]
