"""The sun's mirror image on a marker: where it blinds the camera, and where it cannot."""

import numpy as np
import pytest

from grape.sim.sensors.rgbd import GlossyPlate, RgbdModel, measured_color, measured_depth, sun_on_plate
from grape.sim.worlds import VineyardOptions, generate_vineyard

K = np.array([[466.0, 0.0, 319.5], [0.0, 466.0, 239.5], [0.0, 0.0, 1.0]])
DEPTH = np.full((480, 640), 0.3, np.float32)
FACING = np.diag([1.0, -1.0, -1.0])  # the plate looks back along the optical axis


def plate(gloss_deg=4.0, R=FACING, x=0.0):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [x, 0.0, 0.3]
    return GlossyPlate(T_camera_plate=T, half_size=np.array([0.03, 0.03]), gloss_rad=np.radians(gloss_deg))


BEHIND = np.array([0.0, 0.0, -1.0])  # the sun straight behind the camera


def test_the_sun_behind_the_camera_is_mirrored_in_the_middle_of_a_plate():
    pixels = sun_on_plate(plate(), BEHIND, K, DEPTH)
    radius = 466.0 * np.tan(np.radians(4.0))
    assert pixels.mean(axis=0) == pytest.approx([239.5, 319.5], abs=0.2)
    assert len(pixels) == pytest.approx(np.pi * radius**2, rel=0.03)


def test_glare_stays_on_the_plate():
    pixels = sun_on_plate(plate(gloss_deg=40.0), BEHIND, K, DEPTH)
    half = 0.03 / 0.3 * 466.0
    assert np.abs(pixels - [239.5, 319.5]).max() <= half + 1
    assert len(pixels) == pytest.approx((2 * half) ** 2, rel=0.05)


def test_a_sun_elsewhere_is_mirrored_elsewhere():
    assert sun_on_plate(plate(), np.array([0.6, 0.0, -0.8]), K, DEPTH) is None
    aside = np.array([np.sin(0.1), 0.0, -np.cos(0.1)])
    found = sun_on_plate(plate(), aside, K, DEPTH)
    assert found[:, 1].mean() > 319.5 + 20, "on the side where the sun is"


def test_a_plate_turned_away_or_hidden_does_not_blind():
    assert sun_on_plate(plate(R=np.eye(3)), BEHIND, K, DEPTH) is None
    assert sun_on_plate(plate(), -BEHIND, K, DEPTH) is None
    assert sun_on_plate(plate(), BEHIND, K, DEPTH - 0.05) is None
    assert sun_on_plate(plate(x=2.0), BEHIND, K, DEPTH) is None


def test_saturated_pixels_are_white_and_without_depth():
    pixels = np.array([[v, u] for v in range(20, 40) for u in range(30, 60)])
    model, noise = RgbdModel(), np.zeros((100, 100, 3), np.int16)
    bgr = measured_color(np.full((100, 100, 3), 40, np.uint8), noise, model, pixels)
    assert (bgr[25:35, 35:55] == 255).all() and (bgr[60:, 70:] == 40).all()
    depth = measured_depth(np.full((100, 100), 0.5, np.float32), noise[..., 0].astype(float), 466.0, model, pixels)
    assert (depth[20:40, 30:60] == 0).all() and (depth[50:] > 0.4).all()


@pytest.mark.parametrize(
    ("light", "glossy"), [({}, 0.0), ({"glare": 1.0}, 12.0), ({"glare": 1.0, "sun": "overcast"}, 0)]
)
def test_only_glossy_markers_under_a_clear_sky_can_blind(light, glossy):
    world = generate_vineyard(VineyardOptions(rows=1, vines_per_row=2, nails_per_row=1, **light))
    assert np.degrees(world.sun.gloss_rad) == pytest.approx(glossy)
