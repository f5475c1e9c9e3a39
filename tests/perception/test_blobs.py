"""Coloured blobs: colour, depth gate, size, shape."""

import cv2
import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.messages import CameraInfo, RgbdImage
from grape.perception.blobs import BlobOptions, find_blobs

K = np.array([[615.0, 0, 319.5], [0, 615.0, 239.5], [0, 0, 1]])
RED, BROWN, GREY = (20, 20, 210), (35, 70, 140), (90, 90, 90)


def image(boxes=(), depth=1.0, K=K):
    """Boxes (u, v, w, h, colour, depth) on a grey ground at `depth`."""
    bgr = np.full((480, 640, 3), GREY, np.uint8)
    z = np.full((480, 640), depth, np.float32)
    for u, v, w, h, colour, near in boxes:
        bgr[v : v + h, u : u + w] = colour
        z[v : v + h, u : u + w] = near
    return RgbdImage(stamp=0.0, bgr=bgr, depth=z, info=CameraInfo(stamp=0.0, width=640, height=480, K=K))


def test_a_red_box_is_found_with_its_place():
    (blob,) = find_blobs(image([(300, 200, 20, 24, RED, 0.25)]), depth_range=(0.2, 0.3))
    np.testing.assert_allclose(blob.centre, [309.5, 211.5], atol=0.6)
    assert blob.depth_m == pytest.approx(0.25)
    np.testing.assert_allclose(blob.position, [-10 / 615 * 0.25, -28 / 615 * 0.25, 0.25], atol=0.001)
    assert blob.solidity > 0.9 and blob.hull_distance < 0.05


def test_what_is_farther_than_the_gate_does_not_count():
    picture = image([(300, 200, 20, 24, RED, 0.5)])
    assert find_blobs(picture, depth_range=(0.2, 0.3)) == ()
    assert len(find_blobs(picture)) == 1


def test_overlapping_red_at_two_depths_is_told_apart_by_the_gate():
    picture = image([(280, 180, 90, 60, RED, 0.4), (300, 200, 20, 24, RED, 0.25)])
    (blob,) = find_blobs(picture, depth_range=(0.2, 0.3))
    np.testing.assert_allclose(blob.centre, [309.5, 211.5], atol=1.0)


def test_brown_is_not_red():
    assert find_blobs(image([(300, 200, 20, 24, BROWN, 0.25)])) == ()


@pytest.mark.parametrize("hole", [0.0, np.nan])
def test_missing_depth_at_a_rim_is_filled_but_a_blob_without_depth_is_not_in_the_gate(hole):
    rim = image([(300, 200, 20, 24, RED, hole), (302, 202, 16, 20, RED, 0.25)])
    (blob,) = find_blobs(rim, depth_range=(0.2, 0.3))
    assert blob.area_px > 380 and blob.depth_m == pytest.approx(0.25)
    assert find_blobs(image([(300, 200, 20, 24, RED, hole)]), depth_range=(0.2, 0.3)) == ()


def test_without_a_gate_a_blob_without_depth_has_nan():
    (blob,) = find_blobs(image([(300, 200, 20, 24, RED, 0.0)]))
    assert np.isnan(blob.depth_m) and np.isnan(blob.position).all()


def test_area_limits_scale_with_the_focal_length():
    boxes = [(300, 200, 9, 9, RED, 0.25)]  # 64 px of contour: enough at f = 300, and just enough at 615
    wide = np.array([[300.0, 0, 319.5], [0, 300.0, 239.5], [0, 0, 1]])
    far = np.array([[1230.0, 0, 319.5], [0, 1230.0, 239.5], [0, 0, 1]])
    assert len(find_blobs(image(boxes, K=wide))) == 1
    assert find_blobs(image(boxes, K=far)) == ()


def test_a_ragged_shape_is_refused_by_its_hull():
    picture = image([(300, 200, 60, 6, RED, 0.25), (300, 200, 6, 60, RED, 0.25)])
    assert find_blobs(picture) == ()
    assert len(find_blobs(picture, BlobOptions(solidity=0.0, hull_distance=np.inf))) == 1


def test_a_region_leaves_the_rest_out():
    picture = image([(100, 200, 20, 24, RED, 0.25), (400, 200, 20, 24, RED, 0.25)])
    (blob,) = find_blobs(picture, roi=(300, 0, 640, 480))
    assert blob.centre[0] > 300


def test_blobs_come_largest_first():
    areas = [b.area_px for b in find_blobs(image([(100, 200, 15, 15, RED, 0.3), (400, 200, 25, 25, RED, 0.3)]))]
    assert len(areas) == 2 and areas[0] > areas[1]


def test_hue_may_be_a_plain_range():
    green = cv2.cvtColor(np.uint8([[[60, 200, 200]]]), cv2.COLOR_HSV2BGR)[0, 0]
    picture = image([(300, 200, 20, 24, tuple(int(c) for c in green), 0.25)])
    assert len(find_blobs(picture, BlobOptions(hue=(50, 70)))) == 1 and find_blobs(picture) == ()


def test_a_depth_image_of_another_size_is_refused():
    info = CameraInfo(stamp=0.0, width=4, height=4, K=K)
    picture = RgbdImage(stamp=0.0, bgr=np.zeros((4, 4, 3), np.uint8), depth=np.zeros((5, 4), np.float32), info=info)
    with pytest.raises(InvalidInput, match="registered"):
        find_blobs(picture)


def test_an_empty_or_grey_image_is_refused():
    info = CameraInfo(stamp=0.0, width=4, height=4, K=K)
    for bgr in (np.zeros((0, 0, 3), np.uint8), np.zeros((4, 4), np.uint8)):
        with pytest.raises(InvalidInput, match="uint8"):
            find_blobs(RgbdImage(stamp=0.0, bgr=bgr, depth=np.zeros((4, 4), np.float32), info=info))


def test_options_out_of_range_are_refused():
    for bad in ({"hue": (200, 5)}, {"area_px": (9.0, 3.0)}, {"open_px": -1}):
        with pytest.raises(InvalidInput):
            BlobOptions(**bad)
