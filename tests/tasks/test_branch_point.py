"""The spur's tip near a prediction, in rendered images."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import transform
from grape.messages import CameraInfo, RgbdImage
from grape.perception.markers import project
from grape.tasks.dispenser.perception.branch_point import BranchPointOptions, branch_point, reference_colour

K = np.array([[466.0, 0.0, 319.5], [0.0, 466.0, 239.5], [0.0, 0.0, 1.0]])


@pytest.fixture(params=[("noon", ".45 .36 .25"), ("low", ".60 .27 .17")])
def sight(request, make_scene, views):
    """Image of the spur with a held loop before it, the tip's true pixel and depth."""
    scene = make_scene(*request.param)
    scene.fill(0)
    scene.hang(None)
    image, T_camera_world = scene.look(views.at_spur(50, 0.08), held=True)
    tip = transform(T_camera_world, np.add(views.SPUR_TIP, [0, 0, 0.005]))
    return image, project(tip[None], views.K)[0], float(tip[2])


@pytest.mark.parametrize("off", [(0, 0), (12, 6), (-15, 10), (5, -20)])
def test_the_tip_is_found_from_a_prediction_that_is_off(sight, off):
    image, pixel, depth = sight
    guess = pixel + off
    colour = reference_colour(image, guess, depth + 0.006)
    point = branch_point(image, guess, depth + 0.006, colour)
    assert point.pixel is not None, point.reason
    assert np.linalg.norm(point.pixel - pixel) < 5
    assert abs(point.depth_m - depth) < 0.008
    assert point.circle_px[1] > point.pixel[1] and point.area_px > 50


def test_nothing_at_the_predicted_depth_is_said(sight):
    image, pixel, _ = sight
    colour = reference_colour(image, pixel, sight[2])
    point = branch_point(image, pixel, 0.55, colour)
    assert point.pixel is None and "depth" in point.reason
    assert reference_colour(image, pixel, 0.55) is None


def test_another_colour_is_not_taken(sight):
    image, pixel, depth = sight
    point = branch_point(image, pixel, depth, np.array([250.0, 90.0, 90.0]))
    assert point.pixel is None and "colour" in point.reason


def test_a_tip_too_far_from_the_prediction_is_not_it(sight):
    image, pixel, depth = sight
    colour = reference_colour(image, pixel, depth)
    point = branch_point(image, np.add(pixel, [0, 30]), depth, colour, BranchPointOptions(max_jump_m=0.01))
    assert point.pixel is None and "mm off" in point.reason


def test_a_prediction_outside_the_image_is_said(sight):
    image, _, depth = sight
    point = branch_point(image, np.array([-300.0, 100.0]), depth, np.array([100.0, 128, 128]))
    assert point.pixel is None and "outside" in point.reason
    assert reference_colour(image, np.array([-300.0, 100.0]), depth) is None


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_too_near_for_the_depth_camera_the_colour_alone_finds_it_and_the_depth_is_none(sight, value):
    image, pixel, depth = sight
    colour = reference_colour(image, pixel, depth)
    blind = image.depth.copy()
    near = np.abs(blind - depth) < 0.03
    blind[near] = value
    blind_image = RgbdImage(stamp=0.0, bgr=image.bgr, depth=blind, info=image.info)
    point = branch_point(blind_image, pixel, 0.205, colour, BranchPointOptions(window_m=0.02))
    assert point.pixel is not None, point.reason
    assert point.depth_m is None and np.linalg.norm(point.pixel - pixel) < 6


def test_predictions_that_are_not_finite_are_refused(sight):
    image, pixel, depth = sight
    colour = np.array([100.0, 128, 128])
    with pytest.raises(InvalidInput, match="pixel"):
        branch_point(image, np.array([np.nan, 0]), depth, colour)
    with pytest.raises(InvalidInput, match="depth"):
        branch_point(image, pixel, 0.0, colour)
    with pytest.raises(InvalidInput, match="reference"):
        branch_point(image, pixel, depth, np.zeros(2))
    with pytest.raises(InvalidInput, match="positive"):
        BranchPointOptions(window_m=0.0)


def test_a_tube_in_front_does_not_cut_the_spur_in_two():
    height, width, depth = 480, 640, np.full((480, 640), 2.0, np.float32)
    bgr = np.full((height, width, 3), (40, 110, 70), np.uint8)
    bgr[200:420, 310:330], depth[200:420, 310:330] = (30, 38, 46), 0.25  # a spur, its tip at row 200
    for shift in range(8):  # a brown tube across it, 20 px under the tip
        columns = np.arange(220, 420)
        rows = columns // 2 + 60 + shift
        bgr[rows, columns], depth[rows, columns] = (30, 60, 130), 0.215
    info = CameraInfo(stamp=0.0, frame_id="camera_optical", width=width, height=height, K=K)
    image = RgbdImage(stamp=0.0, frame_id="camera_optical", bgr=bgr, depth=depth, info=info)
    colour = reference_colour(image, np.array([320.0, 300.0]), 0.25)
    point = branch_point(image, np.array([320.0, 235.0]), 0.25, colour)
    assert point.pixel == pytest.approx((320, 200), abs=2)
    depth[(bgr == (30, 60, 130)).all(axis=2)] = 0.4  # behind the spur it hides nothing: these are two things
    image = RgbdImage(stamp=0.0, frame_id="camera_optical", bgr=bgr, depth=depth, info=info)
    cut = branch_point(image, np.array([320.0, 235.0]), 0.25, colour)
    assert cut.pixel[1] > 220
