"""The spur's tip near a prediction, in rendered images."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import transform
from grape.messages import CameraInfo, RgbdImage
from grape.perception.blobs import back_project
from grape.perception.markers import project
from grape.tasks.dispenser.perception.branch_point import BranchPointOptions, branch_point, reference_colour

K = np.array([[466.0, 0.0, 319.5], [0.0, 466.0, 239.5], [0.0, 0.0, 1.0]])
PX_5_MM = 466.0 * 0.005 / 0.297
GREY = np.array([100.0, 128.0, 128.0])


@pytest.fixture(params=[("noon", ".45 .36 .25"), ("low", ".60 .27 .17")])
def sight(request, make_scene, views):
    """Image of the spur with a held loop before it; the tip's true place and the spur's direction, optical frame."""
    scene = make_scene(*request.param)
    scene.fill(0)
    scene.hang(None)
    image, T_camera_world = scene.look(views.at_spur(50, 0.08), held=True)
    tip = transform(T_camera_world, np.add(views.SPUR_TIP, [0, 0, 0.005]))
    return image, tip, T_camera_world[:3, :3] @ [0.0, 0.0, 1.0]


@pytest.mark.parametrize("off", [(0, 0, 0), (0.012, 0.006, 0.01), (-0.012, 0, -0.012), (0.005, -0.018, 0)])
def test_the_tip_is_found_from_a_prediction_that_is_off(sight, off):
    image, tip, direction = sight
    colour = reference_colour(image, tip + off, direction)
    point = branch_point(image, tip + off, direction, colour)
    assert point.pixel is not None, point.reason
    assert np.linalg.norm(point.pixel - project(tip[None], image.info.K)[0]) < PX_5_MM
    assert abs(point.depth_m - tip[2]) < 0.010
    assert point.area_px > 50


def test_with_the_diameter_it_is_the_axis_that_is_found(sight):
    image, tip, direction = sight
    colour = reference_colour(image, tip, direction)
    point = branch_point(image, tip, direction, colour, diameter_m=0.010)
    assert abs(branch_point(image, tip, direction, colour).depth_m - tip[2]) > 0.0015, "the side that is seen"
    assert abs(point.depth_m - tip[2]) < 0.0015
    assert np.linalg.norm(back_project(point.pixel, point.depth_m, image.info.K) - tip) < 0.003


def test_a_direction_that_is_off_by_ten_degrees_does_no_harm(sight):
    image, tip, direction = sight
    leaning = direction + 0.18 * np.cross(direction, [0.0, 0.0, 1.0])
    leaning = leaning / np.linalg.norm(leaning)
    point = branch_point(image, tip, leaning, reference_colour(image, tip, leaning))
    assert np.linalg.norm(point.pixel - project(tip[None], image.info.K)[0]) < PX_5_MM


def test_nothing_at_the_predicted_place_is_said(sight):
    image, tip, direction = sight
    colour = reference_colour(image, tip, direction)
    away = tip * 0.55 / tip[2]
    point = branch_point(image, away, direction, colour)
    assert point.pixel is None and "place" in point.reason
    assert reference_colour(image, away, direction) is None


def test_another_colour_is_not_taken(sight):
    image, tip, direction = sight
    point = branch_point(image, tip, direction, np.array([250.0, 90.0, 90.0]))
    assert point.pixel is None and "colour" in point.reason


def test_a_tip_too_far_from_the_prediction_is_not_it(sight):
    image, tip, direction = sight
    colour = reference_colour(image, tip, direction)
    point = branch_point(image, tip - 0.02 * direction, direction, colour, BranchPointOptions(max_jump_m=0.01))
    assert point.pixel is None and "mm off" in point.reason


def test_a_prediction_outside_the_image_is_said(sight):
    image, tip, direction = sight
    outside = tip - np.array([0.5, 0.0, 0.0])
    point = branch_point(image, outside, direction, GREY)
    assert point.pixel is None and "outside" in point.reason
    assert reference_colour(image, outside, direction) is None


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_spur_without_depth_is_not_found(sight, value):
    image, tip, direction = sight
    colour = reference_colour(image, tip, direction)
    blind = image.depth.copy()
    blind[np.abs(blind - tip[2]) < 0.06] = value
    blind_image = RgbdImage(stamp=0.0, bgr=image.bgr, depth=blind, info=image.info)
    assert branch_point(blind_image, tip, direction, colour).pixel is None


def test_predictions_that_are_not_finite_are_refused(sight):
    image, tip, direction = sight
    with pytest.raises(InvalidInput, match="tip"):
        branch_point(image, np.array([np.nan, 0, 0.3]), direction, GREY)
    with pytest.raises(InvalidInput, match="before the camera"):
        branch_point(image, -tip, direction, GREY)
    with pytest.raises(InvalidInput, match="unit vector"):
        branch_point(image, tip, 2 * direction, GREY)
    with pytest.raises(InvalidInput, match="reference"):
        branch_point(image, tip, direction, np.zeros(2))
    with pytest.raises(InvalidInput, match="positive"):
        BranchPointOptions(radius_m=0.0)


@pytest.mark.parametrize("tube_depth", [0.215, 0.235])
def test_a_tube_in_front_neither_cuts_the_spur_nor_is_taken_for_it(tube_depth):
    depth = np.full((480, 640), 2.0, np.float32)
    bgr = np.full((480, 640, 3), (40, 110, 70), np.uint8)
    bgr[200:420, 310:330], depth[200:420, 310:330] = (30, 38, 46), 0.25  # a spur, its tip at row 200
    for shift in range(8):  # a tube of the spur's colour across it, 20 px under the tip
        columns = np.arange(220, 420)
        rows = columns // 2 + 60 + shift
        bgr[rows, columns], depth[rows, columns] = (30, 38, 46), tube_depth
    info = CameraInfo(stamp=0.0, frame_id="camera_optical", width=640, height=480, K=K)
    image = RgbdImage(stamp=0.0, frame_id="camera_optical", bgr=bgr, depth=depth, info=info)
    up = np.array([0.0, -1.0, 0.0])
    tip = 0.25 * np.array([0.0, (200 - 239.5) / 466, 1.0])
    for off in ((0.0, 0.015, 0.0), (0.008, 0.0, 0.005), (-0.008, 0.01, -0.005)):
        colour = reference_colour(image, tip + off, up)
        point = branch_point(image, tip + off, up, colour)
        assert point.pixel == pytest.approx((319.5, 200), abs=3)
