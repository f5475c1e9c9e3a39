"""A moving LiDAR: assembly, deskewing, smoothing, range bias."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose, rotation_x, rotation_z
from grape.messages import LaserScan
from grape.perception.sweep import AssembleOptions, BiasOptions, Sweep, assemble, debias, range_bias, smooth_sweep

UPRIGHT = rotation_x(np.pi / 2)  # the scan plane x-y becomes x-z of the map


def scan(ranges, start=-0.5, step=None):
    step = 1.0 / (len(ranges) - 1) if step is None else step
    return LaserScan(
        stamp=0.0, angle_min=start, angle_increment=step, range_min=0.05, range_max=10.0, ranges=np.array(ranges)
    )


def wall_sweep(n=40, beams=200, noise=0.0, bias=0.0, bumps=True):
    """Scans of a bumpy wall near x = 0.5 from a sensor that moves along y; returns the sweep and the true cloud."""
    rng = np.random.default_rng(4)
    angles = np.linspace(-0.8, 0.8, beams)
    poses = [pose(UPRIGHT, (0, y, 0)) for y in np.linspace(-0.2, 0.2, n)]
    scans, truth = [], []
    for T in poses:
        y = T[1, 3]
        depth = 0.5 + (0.05 * np.sin(40 * y) * np.cos(9 * angles) if bumps else 0.0)
        r = depth / np.cos(angles)
        truth.append(np.column_stack([r * np.cos(angles), np.full(beams, y), r * np.sin(angles)]))
        scans.append(scan(r + bias + rng.normal(0, noise, beams), -0.8, 1.6 / (beams - 1)))
    return assemble(scans, poses), np.vstack(truth)


def test_points_land_where_the_beams_hit():
    sweep = assemble([scan([1.0, 1.0, 1.0])], [pose(rotation_z(np.pi / 2), (1, 2, 3))])
    np.testing.assert_allclose(sweep.points[1], [1, 3, 3], atol=1e-12)
    np.testing.assert_allclose(sweep.origins, np.tile([1, 2, 3], (3, 1)))
    np.testing.assert_allclose(sweep.directions[1], [0, 1, 0], atol=1e-12)


def test_no_return_too_near_and_out_of_the_bearing_window_are_left_out():
    ranges = [np.inf, -np.inf, np.nan, 0.01, 1.0, 1.0, 99.0]
    sweep = assemble([scan(ranges)], [np.eye(4)], AssembleOptions(bearing_rad=(-1.0, 0.2)))
    assert list(sweep.beam) == [4]


def test_deskewing_puts_each_beam_where_the_sensor_was():
    ranges = np.full(101, 1.0)
    start, end = pose(translation=(0, 0, 0)), pose(translation=(0, 0, 0.1))
    sweep = assemble([scan(ranges)], [start], T_map_lidar_end=[end])
    np.testing.assert_allclose(sweep.points[:, 2], np.linspace(0, 0.1, 101), atol=1e-9)
    assert np.ptp(assemble([scan(ranges)], [start]).points[:, 2]) == 0.0


def test_no_scans_make_an_empty_sweep():
    sweep = assemble([], [])
    assert sweep.points.shape == (0, 3) and smooth_sweep(sweep).points.shape == (0, 3)
    assert range_bias(sweep, np.zeros((5, 3))) is None


def test_smoothing_takes_the_noise_down_and_lone_returns_out():
    sweep, truth = wall_sweep(noise=0.006, bumps=False)
    before = np.linalg.norm(sweep.points - truth, axis=1).mean()
    smooth = smooth_sweep(sweep)
    rows = smooth.scan * 200 + smooth.beam
    after = np.linalg.norm(smooth.points - truth[rows], axis=1).mean()
    assert after < 0.5 * before
    lone = Sweep(points=np.array([[1.0, 0, 0]]), origins=np.zeros((1, 3)), ranges=np.ones(1), scan=[0], beam=[0])
    assert len(smooth_sweep(lone).points) == 0


@pytest.mark.parametrize("bias", [0.046, -0.06, 0.0])
def test_a_constant_range_error_is_found_against_the_camera_and_taken_off(bias):
    sweep, truth = wall_sweep(noise=0.006, bias=bias)
    camera = truth[::3] + np.random.default_rng(5).normal(0, 0.001, truth[::3].shape)
    found = range_bias(sweep, camera)
    assert found == pytest.approx(bias, abs=0.004)
    corrected = debias(sweep, found)
    assert abs(np.median(np.linalg.norm(corrected.points, axis=1) - np.linalg.norm(truth, axis=1))) < 0.005


def test_clouds_that_do_not_overlap_tell_no_bias():
    sweep, _ = wall_sweep()
    assert range_bias(sweep, np.array([[5.0, 5.0, 5.0]])) is None
    assert range_bias(sweep, np.empty((0, 3))) is None


def test_each_scan_needs_a_pose():
    with pytest.raises(InvalidInput, match="poses"):
        assemble([scan([1.0, 1.0])], [])
    with pytest.raises(InvalidInput, match="not a 4 x 4 pose"):
        assemble([scan([1.0, 1.0])], [np.ones((4, 4))])
    with pytest.raises(InvalidInput, match="shape"):
        bad = LaserScan(stamp=0.0, angle_min=0, angle_increment=1, range_min=0, range_max=1, ranges=np.zeros((2, 2)))
        assemble([bad], [np.eye(4)])


def test_options_and_rows_that_make_no_sense_are_refused():
    with pytest.raises(InvalidInput, match="rise"):
        AssembleOptions(range_m=(2.0, 1.0))
    with pytest.raises(InvalidInput, match="positive"):
        BiasOptions(step_m=0.0)
    with pytest.raises(InvalidInput, match="rows"):
        Sweep(points=np.zeros((2, 3)), origins=np.zeros((1, 3)), ranges=np.ones(2), scan=[0, 0], beam=[0, 1])
