"""Corners by edges have no bias towards the inside, which corners by windows have."""

import cv2
import numpy as np
import pytest

from grape.perception.marker_edges import refine_corners
from grape.perception.markers import MarkerDetector

CELLS = 6


def picture(corners, blur=0.8, noise=2.0, seed=0):
    """A marker with its white margin, drawn through a homography at eight times the size; pixel centres are whole."""
    scale = 8
    code = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 3, 6 * 40)
    framed = cv2.copyMakeBorder(code, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    source = np.float32([[60, 60], [300, 60], [300, 300], [60, 300]]) - 0.5
    H = cv2.getPerspectiveTransform(source, np.float32((np.asarray(corners) + 0.5) * scale - 0.5))
    large = cv2.warpPerspective(framed, H, (160 * scale, 120 * scale), flags=cv2.INTER_LINEAR, borderValue=90)
    small = cv2.resize(large, (160, 120), interpolation=cv2.INTER_AREA)
    rng = np.random.default_rng(seed)
    return np.clip(cv2.GaussianBlur(small, (0, 0), blur) + rng.normal(0, noise, small.shape), 0, 255).astype(np.uint8)


CORNERS = np.array([[40.3, 28.7], [102.6, 33.2], [96.4, 90.1], [37.8, 84.5]])


def inwards(found):
    """Mean distance (px) by which corners lie nearer to the middle than they should."""
    middle = CORNERS.mean(axis=0)
    return float((np.linalg.norm(CORNERS - middle, axis=1) - np.linalg.norm(found - middle, axis=1)).mean())


def test_corners_found_by_edges_have_no_inward_bias():
    found = np.array([refine_corners(picture(CORNERS, seed=k), CORNERS + 0.4, CELLS) for k in range(8)])
    assert abs(inwards(found.mean(axis=0))) < 0.04
    assert np.sqrt(((found - CORNERS) ** 2).sum(axis=2).mean()) < 0.08


def test_the_detector_gives_refined_corners():
    (marker,) = MarkerDetector("4X4_50").detect(picture(CORNERS))
    assert marker.id == 3
    assert np.abs(marker.corners - CORNERS).max() < 0.12


def test_a_covered_edge_leaves_the_corners_as_they_were():
    image = picture(CORNERS)
    image[:, 90:] = 255
    assert refine_corners(image, CORNERS, CELLS) == pytest.approx(CORNERS)


def test_a_marker_too_small_for_profiles_keeps_its_corners():
    small = 50.0 + 0.2 * (CORNERS - CORNERS.mean(axis=0))
    assert refine_corners(picture(small), small, CELLS) == pytest.approx(small)


def test_a_corner_that_would_move_far_keeps_its_place():
    off = CORNERS + np.array([0.0, 2.8])
    assert refine_corners(picture(CORNERS), off, CELLS) == pytest.approx(off)
