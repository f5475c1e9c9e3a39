"""Held and hung: the red wings in rendered images, true and false cases."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import inverse, pose, rotation_z, transform
from grape.messages import CameraInfo, RgbdImage
from grape.tasks.dispenser.perception.wings import HungExpectation, HungOptions, held, hung

RED_SOIL = ".60 .27 .17"
LIGHTS = [("noon", ".45 .36 .25"), ("overcast", ".45 .36 .25"), ("low", RED_SOIL), ("noon", RED_SOIL)]
UPRIGHT = np.column_stack([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # a loop that hangs in front of the robot


def blank(colour=(90, 90, 90), depth=1.0, shape=(480, 640)):
    info = CameraInfo(stamp=0.0, width=640, height=480, K=np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]]))
    bgr = np.full((*shape, 3), colour, np.uint8)
    return RgbdImage(stamp=0.0, bgr=bgr, depth=np.full(shape, depth, np.float32), info=info)


def expectation(T_camera_world, views):
    nails = transform(inverse(views.T_HAND_CAMERA), views.NAILS_OPEN)
    return HungExpectation(target=transform(T_camera_world, views.SPUR_TIP), nails=nails)


@pytest.mark.parametrize(("sun", "ground"), LIGHTS)
def test_a_held_loop_is_seen_over_the_feeder_and_before_the_vine(make_scene, views, sun, ground):
    scene = make_scene(sun, ground)
    scene.hang(None)
    for loops, T in ((3, views.over_feeder(3, 0.12)), (0, views.at_spur(45, 0.10)), (0, views.at_spur(60, 0.05))):
        scene.fill(loops)
        check = held(scene.look(T, held=True)[0])
        assert check.value, check.reason
        assert abs(check.blobs[0].depth_m - 0.233) < 0.01


@pytest.mark.parametrize(("sun", "ground"), LIGHTS)
def test_empty_nails_are_not_held_even_over_a_full_feeder(make_scene, views, sun, ground):
    scene = make_scene(sun, ground)
    scene.hang(None)
    for loops in (8, 3, 0):
        scene.fill(loops)
        for T in (views.over_feeder(loops, 0.12), views.at_spur(45, 0.10)):
            assert not held(scene.look(T, held=False)[0]).value


def test_a_loop_on_the_spur_is_not_held(make_scene, views):
    scene = make_scene()
    scene.fill(0)
    scene.hang(pose(UPRIGHT, np.add(views.SPUR_TIP, [0, -0.012, -0.07])))
    check = held(scene.look(views.at_spur(60, 0.12, 0.05))[0])
    assert not check.value and "0 wings" in check.reason


@pytest.mark.parametrize("turn", [-40, 0, 40])
@pytest.mark.parametrize(("sun", "ground"), LIGHTS)
def test_a_hung_loop_is_seen_after_backing_off(make_scene, views, sun, ground, turn):
    scene = make_scene(sun, ground)
    scene.fill(0)
    scene.hang(pose(rotation_z(np.radians(turn)) @ UPRIGHT, np.add(views.SPUR_TIP, [0, -0.012, -0.07])))
    image, T_camera_world = scene.look(views.at_spur(60, 0.12, 0.05), fingers="closed")
    check = hung(image, expectation(T_camera_world, views))
    assert check.value, check.reason


def a_strip_of_a_wing(colour, z=0.35):
    image = blank()
    bgr, depth = image.bgr.copy(), image.depth.copy()
    for k in range(13):  # slanting, four pixels wide
        bgr[265 + k, 327 + k // 2 : 331 + k // 2], depth[265 + k, 327 + k // 2 : 331 + k // 2] = colour, z
    return RgbdImage(stamp=0.0, bgr=bgr, depth=depth, info=image.info)


def test_a_wing_seen_from_its_edge_counts_when_it_is_vivid_and_at_its_place():
    vivid = a_strip_of_a_wing((20, 15, 110))
    place = HungExpectation(target=np.array([0.01, 0.03, 0.35]))
    assert hung(vivid, place).value and not hung(vivid, place, HungOptions(edge_on=None)).value
    assert not hung(a_strip_of_a_wing((25, 25, 55)), place).value, "dark wood under a low sun is reddish too"
    assert not hung(a_strip_of_a_wing((20, 15, 110), z=0.9), place).value
    assert not held(vivid).value


@pytest.mark.parametrize(("sun", "ground"), LIGHTS)
def test_nothing_hung_is_not_hung(make_scene, views, sun, ground):
    scene = make_scene(sun, ground)
    scene.fill(0)
    scene.hang(None)
    image, T_camera_world = scene.look(views.at_spur(60, 0.12, 0.05), fingers="closed")
    assert not hung(image, expectation(T_camera_world, views)).value


def test_a_loop_in_the_next_row_or_on_the_next_spur_does_not_count(make_scene, views):
    scene = make_scene()
    scene.fill(0)
    for place in ([0.0, 2.6, -0.07], [0.22, -0.01, -0.07]):
        scene.hang(pose(UPRIGHT, views.SPUR_TIP + place))
        image, T_camera_world = scene.look(views.at_spur(60, 0.12, 0.05), fingers="closed")
        check = hung(image, expectation(T_camera_world, views))
        assert not check.value and "at the target" in check.reason


def test_a_loop_that_stayed_on_the_nails_does_not_count(make_scene, views):
    scene = make_scene()
    scene.fill(0)
    scene.hang(None)
    image, T_camera_world = scene.look(views.at_spur(60, 0.12, 0.05), held=True)
    check = hung(image, expectation(T_camera_world, views))
    assert not check.value and "still at the nails" in check.reason


def test_more_wings_can_be_asked_for(make_scene, views):
    scene = make_scene()
    scene.hang(pose(UPRIGHT, np.add(views.SPUR_TIP, [0, -0.012, -0.07])))
    image, _ = scene.look(views.at_spur(60, 0.12, 0.05), fingers="closed")
    assert hung(image, options=HungOptions(wings=2)).value
    assert not hung(image, options=HungOptions(wings=3)).value


@pytest.mark.parametrize("depth", [0.0, np.nan, 0.24])
def test_an_image_full_of_red_or_without_depth_is_neither_held_nor_hung(depth):
    image = blank((20, 20, 210), depth)
    assert not held(image).value and not hung(image).value


def test_a_grey_image_is_neither_held_nor_hung():
    assert not held(blank()).value and not hung(blank()).value


def wings_at(*boxes):
    image = blank()
    bgr, depth = image.bgr.copy(), image.depth.copy()
    for u, v, z in boxes:
        bgr[v : v + 22, u : u + 20], depth[v : v + 22, u : u + 20] = (20, 20, 210), z
    return RgbdImage(stamp=0.0, bgr=bgr, depth=depth, info=image.info)


def test_wings_of_different_depth_or_too_far_apart_are_no_held_loop():
    assert held(wings_at((250, 320, 0.235), (375, 320, 0.235))).value
    assert "differ" in held(wings_at((250, 320, 0.210), (375, 320, 0.260))).reason
    assert "apart" in held(wings_at((201, 320, 0.265), (418, 320, 0.265))).reason
    assert "3 wings" in held(wings_at((250, 320, 0.235), (375, 320, 0.235), (310, 250, 0.235))).reason


def test_wings_outside_the_central_window_are_no_held_loop():
    assert not held(wings_at((20, 20, 0.235), (145, 20, 0.235))).value


def test_images_of_the_wrong_shape_are_refused():
    with pytest.raises(InvalidInput):
        held(blank(shape=(0, 0)))
    good = blank()
    bad = RgbdImage(stamp=0.0, bgr=good.bgr, depth=np.zeros((10, 10), np.float32), info=good.info)
    for check in (held, hung):
        with pytest.raises(InvalidInput, match="registered"):
            check(bad)


def test_an_expectation_needs_points_and_positive_radii():
    with pytest.raises(InvalidInput, match="target"):
        HungExpectation(target=np.array([np.nan, 0, 0]))
    with pytest.raises(InvalidInput, match="radii"):
        HungExpectation(radius_m=0.0)
