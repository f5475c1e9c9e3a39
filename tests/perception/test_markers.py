"""Markers drawn into an image by a known pose are found and give that pose back."""

import cv2
import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose, pose_error, rotation_from_rpy, rotation_x, transform
from grape.perception.markers import (
    Marker,
    MarkerDetector,
    MarkerOptions,
    board_pose,
    corner_points,
    marker_pose,
    project,
)

K = np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]])
SIDE = 0.04
FACING = pose(rotation_x(np.pi))  # the face looks back at the camera


def draw(poses, side=SIDE, margin=0.01, background=110):
    """A grey image of markers {id: T_camera_marker}, anti-aliased by drawing at four times the size."""
    scale = 4
    big = K.copy()
    big[:2] *= scale
    big[:2, 2] = (K[:2, 2] + 0.5) * scale - 0.5
    image = np.full((480 * scale, 640 * scale), background, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cells = 40
    for id, T in poses.items():
        border = round(6 * cells * margin / side)
        face = cv2.copyMakeBorder(
            cv2.aruco.generateImageMarker(dictionary, id, 6 * cells), *[border] * 4, cv2.BORDER_CONSTANT, value=255
        )
        n = face.shape[0]
        pixels = project(transform(T, corner_points(side + 2 * margin)), big)
        texture = np.array([[-0.5, -0.5], [n - 0.5, -0.5], [n - 0.5, n - 0.5], [-0.5, n - 0.5]])
        H, _ = cv2.findHomography(texture, pixels)
        size = (image.shape[1], image.shape[0])
        mask = cv2.warpPerspective(np.full_like(face, 255), H, size)
        image = np.where(mask > 127, cv2.warpPerspective(face, H, size), image)
    return cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)


def at(x, y, z, roll=0.0, pitch=0.0, yaw=0.0):
    return pose(rotation_from_rpy(roll, pitch, yaw), (x, y, z)) @ FACING


def test_corners_are_found_in_order_within_half_a_pixel():
    T = at(0.02, -0.01, 0.35, 0.3, -0.2, 0.5)
    (marker,) = MarkerDetector().detect(draw({7: T}))
    assert marker.id == 7
    np.testing.assert_allclose(marker.corners, project(transform(T, corner_points(SIDE)), K), atol=0.5)


def test_a_pose_is_recovered_to_a_millimetre_and_a_degree():
    T = at(0.02, -0.01, 0.30, 0.4, -0.3, 0.5)
    (marker,) = MarkerDetector().detect(draw({1: T}))
    error = pose_error(marker_pose(marker, SIDE, K), T)
    assert np.linalg.norm(error[:2]) < 0.001 and abs(error[2]) < 0.005
    assert np.linalg.norm(error[3:]) < np.radians(1.5)


def test_colour_and_grey_images_give_the_same_markers():
    grey = draw({3: at(0, 0, 0.3)})
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    a, b = MarkerDetector().detect(grey), MarkerDetector().detect(colour)
    np.testing.assert_allclose(a[0].corners, b[0].corners, atol=1e-6)


def test_a_region_gives_corners_in_the_whole_image():
    grey = draw({1: at(-0.06, 0, 0.3), 2: at(0.06, 0, 0.3)})
    whole = {m.id: m for m in MarkerDetector().detect(grey)}
    (left,) = MarkerDetector().detect(grey, roi=(100, 100, 320, 380))
    assert set(whole) == {1, 2} and left.id == 1
    np.testing.assert_allclose(left.corners, whole[1].corners, atol=0.3)


def test_an_image_without_markers_has_none():
    assert MarkerDetector().detect(np.full((480, 640), 128, np.uint8)) == ()


def test_markers_below_the_smallest_side_are_left_out():
    grey = draw({1: at(0, 0, 0.3)})
    assert MarkerDetector(options=MarkerOptions(min_side_px=200)).detect(grey) == ()


def test_a_marker_behind_glare_is_not_reported():
    grey = draw({1: at(-0.06, 0, 0.3), 2: at(0.06, 0, 0.3)})
    centre = project(np.array([[-0.05, 0.01, 0.3]]), K)[0]
    cv2.circle(grey, tuple(int(c) for c in centre), 20, 255, -1)
    assert [m.id for m in MarkerDetector().detect(grey)] == [2]


BOARD = {1: pose(translation=(-0.085, -0.06, -0.03)), 2: pose(translation=(0.085, -0.06, -0.03))}


def test_a_board_of_two_markers_is_found_more_exactly_than_one_marker_tells():
    T = at(0.0, 0.0, 0.40, 0.15, 0.1, 0.2)
    markers = MarkerDetector().detect(draw({i: T @ B for i, B in BOARD.items()}))
    board = board_pose(markers, BOARD, SIDE, K)
    error = pose_error(board.T_camera_board, T)
    assert board.ids == (1, 2) and board.error_px < 0.5
    assert np.linalg.norm(error[:3]) < 0.003 and np.linalg.norm(error[3:]) < np.radians(0.7)


def test_one_marker_of_a_board_is_enough_and_foreign_markers_are_ignored():
    T = at(0.0, 0.0, 0.35, 0.2, 0.3, 0.0)
    markers = MarkerDetector().detect(draw({1: T @ BOARD[1], 9: at(0.05, 0.06, 0.35)}))
    board = board_pose(markers, BOARD, SIDE, K)
    assert board.ids == (1,)
    assert np.linalg.norm(pose_error(board.T_camera_board, T)[:3]) < 0.015


def test_a_board_without_its_markers_is_refused():
    markers = MarkerDetector().detect(draw({9: at(0, 0, 0.3)}))
    with pytest.raises(InvalidInput, match=r"\[9\]"):
        board_pose(markers, BOARD, SIDE, K)


def test_an_unknown_dictionary_is_refused_with_a_suggestion():
    with pytest.raises(InvalidInput, match="did you mean '4X4_50'"):
        MarkerDetector("4x4_5O")


@pytest.mark.parametrize(
    "image", [np.zeros((0, 0), np.uint8), np.zeros((5, 5)), np.zeros((5, 5, 4), np.uint8), np.zeros(5, np.uint8)]
)
def test_images_of_another_shape_or_type_are_refused(image):
    with pytest.raises(InvalidInput, match="uint8"):
        MarkerDetector().detect(image)


def test_a_region_outside_the_image_is_refused():
    with pytest.raises(InvalidInput, match="roi"):
        MarkerDetector().detect(np.zeros((48, 64), np.uint8), roi=(100, 0, 200, 40))


def test_corners_that_are_not_four_finite_points_are_refused():
    for corners in (np.zeros((3, 2)), np.full((4, 2), np.nan)):
        with pytest.raises(InvalidInput, match="corners"):
            Marker(id=1, corners=corners)


@pytest.mark.parametrize("side", [0.0, -1.0, np.nan])
def test_a_side_that_is_not_positive_is_refused(side):
    marker = Marker(id=1, corners=project(transform(at(0, 0, 0.3), corner_points(SIDE)), K))
    with pytest.raises(InvalidInput, match="side"):
        marker_pose(marker, side, K)


def test_a_camera_matrix_of_another_shape_is_refused():
    marker = Marker(id=1, corners=project(transform(at(0, 0, 0.3), corner_points(SIDE)), K))
    for bad in (np.eye(4), np.zeros((3, 3)), np.full((3, 3), np.nan)):
        with pytest.raises(InvalidInput, match="camera matrix"):
            marker_pose(marker, SIDE, bad)


def test_marker_options_must_be_positive():
    with pytest.raises(InvalidInput, match="positive"):
        MarkerOptions(window_px=0)
