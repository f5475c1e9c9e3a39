"""Which level of the feeder is on top, in rendered images."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose
from grape.messages import RgbdImage
from grape.perception.markers import MarkerDetector, board_pose
from grape.tasks.dispenser.perception.feeder import FeederGeometry, FeederOptions, feeder_top

GEOMETRY = FeederGeometry()


def see(image):
    board = board_pose(
        MarkerDetector().detect(image.bgr), GEOMETRY.T_feeder_marker, GEOMETRY.marker_side_m, image.info.K
    )
    return feeder_top(image, board.T_camera_board, GEOMETRY), board


@pytest.mark.parametrize("sun", ["noon", "overcast", "low"])
def test_every_level_is_told_from_one_view_above_the_full_feeder(make_scene, views, sun):
    scene = make_scene(sun)
    rng = np.random.default_rng(7)
    for loops in range(1, 9) if sun == "noon" else (1, 5, 8):
        scene.fill(loops)
        T = views.over_feeder(7, 0.12, rng.uniform(-0.02, 0.02, 3))
        top, board = see(scene.look(T, fingers="closed", seed=loops)[0])
        assert board.ids == (1, 2)
        assert top.level == loops - 1, top
        assert abs(top.height_m - 0.018 * top.level) < 0.006
        assert np.linalg.norm(top.midpoint[:2]) < 0.008


@pytest.mark.parametrize("sun", ["noon", "low"])
def test_an_empty_feeder_has_no_top(make_scene, views, sun):
    scene = make_scene(sun, ".60 .27 .17")
    scene.fill(0)
    top, _ = see(scene.look(views.over_feeder(7, 0.12), fingers="closed")[0])
    assert top.level is None and "no red" in top.reason


def hide(image, u, v, half=18):
    """The image with a grey finger over a wing."""
    bgr, depth = image.bgr.copy(), image.depth.copy()
    window = np.s_[int(v) - half : int(v) + half, int(u) - half : int(u) + half]
    bgr[window], depth[window] = 120, 0.21
    return RgbdImage(stamp=0.0, bgr=bgr, depth=depth, info=image.info)


def test_one_hidden_wing_is_no_top_unless_one_side_is_enough(make_scene, views):
    scene = make_scene()
    scene.fill(4)
    image, T_camera_world = scene.look(views.over_feeder(7, 0.12), fingers="closed")
    whole = feeder_top(image, T_camera_world, GEOMETRY)
    half = hide(image, *whole.wings_px[0])
    assert feeder_top(half, T_camera_world, GEOMETRY).level is None
    top = feeder_top(half, T_camera_world, GEOMETRY, FeederOptions(both_sides=False))
    assert top.level == 3 and abs(top.midpoint[0]) < 0.006


def test_a_loop_that_lies_slanted_is_no_top(make_scene, views):
    scene = make_scene()
    scene.fill(0)
    c, s = np.cos(0.4), np.sin(0.4)
    scene.move("d0", pose(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), (0, 0, 0.02)))
    image, T_camera_world = scene.look(views.over_feeder(7, 0.12), fingers="closed")
    assert feeder_top(image, T_camera_world, GEOMETRY).level is None


def test_a_loop_beside_the_feeder_does_not_count(make_scene, views):
    scene = make_scene()
    scene.fill(0)
    scene.move("d0", pose(translation=(0.10, 0.02, 0.0)))
    image, T_camera_world = scene.look(views.over_feeder(7, 0.12), fingers="closed")
    assert feeder_top(image, T_camera_world, GEOMETRY).level is None


def test_an_image_without_depth_has_no_top(make_scene, views):
    scene = make_scene()
    scene.fill(3)
    image, T = scene.look(views.over_feeder(7, 0.12), fingers="closed")
    for value in (0.0, np.nan):
        blind = RgbdImage(stamp=0.0, bgr=image.bgr, depth=np.full_like(image.depth, value), info=image.info)
        assert feeder_top(blind, T, GEOMETRY).level is None


def test_a_pose_that_is_none_is_refused(make_scene, views):
    image, _ = make_scene().look(views.over_feeder(7, 0.12))
    with pytest.raises(InvalidInput, match="T_camera_feeder"):
        feeder_top(image, np.ones((4, 4)), GEOMETRY)


def test_a_geometry_must_be_positive_with_proper_poses():
    with pytest.raises(InvalidInput, match="positive"):
        FeederGeometry(pitch_m=0.0)
    with pytest.raises(InvalidInput, match="pose"):
        FeederGeometry(T_feeder_marker={1: np.ones((4, 4))})
