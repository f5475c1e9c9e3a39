"""What the simulated sensors measure, how well they know it, and when."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from grape.errors import InvalidInput, StaleData
from grape.geodesy import enu_from_geodetic
from grape.geometry import quaternion_to_rotation, transform, yaw_of
from grape.kinematics import ArmModel
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.robots.robi_jaco2 import DESCRIPTION as ROBI
from grape.sim.drivers import SensorOptions
from grape.sim.drivers.gnss import GnssOptions
from grape.sim.faults import CameraGlare, GnssJump
from grape.sim.sensors.gnss import GnssModel, float_spells
from grape.sim.sensors.noise import FrameNoise, SlowDrift
from grape.sim.sensors.ranges import RangeModel, measured_ranges, spot_ranges
from grape.sim.sensors.rgbd import Glare, RgbdModel, measured_depth


def beats(simulation, count):
    for _ in range(count):
        simulation.advance()


def test_the_camera_renders_only_what_is_read(simulate, monkeypatch):
    from grape.sim.render import Renderer

    drawn = []
    original = Renderer.color_and_depth
    monkeypatch.setattr(Renderer, "color_and_depth", lambda *a: drawn.append(1) or original(*a))
    simulation = simulate(dispensers=1)
    beats(simulation, 40)
    assert not drawn
    first = simulation.drivers.camera.latest()
    assert simulation.drivers.camera.latest() is first
    assert len(drawn) == 1


def test_the_camera_is_one_frame_late(simulate):
    simulation = simulate()
    with pytest.raises(StaleData, match="nothing"):
        simulation.drivers.camera.latest()
    beats(simulation, 20)
    image = simulation.drivers.camera.latest()
    assert image.stamp == pytest.approx(0.132)
    assert image.bgr.shape == (480, 640, 3)
    assert image.depth.dtype == np.float32
    assert image.info.K[0, 0] == pytest.approx(466.0, abs=0.1)
    assert simulation.drivers.camera.since(image.stamp) == ()


def test_the_camera_sees_the_feeder_markers_where_the_description_has_them(simulate):
    simulation = simulate(dispensers=2, arm_pose="ready_feeder")
    beats(simulation, 20)
    image, joints = simulation.drivers.camera.latest(), simulation.drivers.arm.latest().position
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(image.bgr)
    assert ids is not None and {1, 2} <= set(ids.ravel())
    T_base_camera = (
        DESCRIPTION.arm.T_base_link_arm_base
        @ ArmModel.from_mjcf(DESCRIPTION.mjcf).fk(joints)
        @ DESCRIPTION.mounts["camera_optical"].T_parent_sensor
    )
    feeder = DESCRIPTION.feeder
    marker = transform(feeder.T_base_link_feeder, feeder.marker_positions[0])
    x, y, z = transform(np.linalg.inv(T_base_camera), marker)
    K = image.info.K
    seen = corners[list(ids.ravel()).index(1)][0].mean(axis=0)
    assert seen == pytest.approx([K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]], abs=3.0)
    u, v = np.round(seen).astype(int)
    assert image.depth[v, u] == pytest.approx(z, abs=0.01)


def test_glare_hides_part_of_the_picture(simulate):
    simulation = simulate()
    simulation.inject(CameraGlare(glare=Glare(u=320, v=240, radius=40)))
    beats(simulation, 20)
    image = simulation.drivers.camera.latest()
    assert (image.bgr[240, 320] == 255).all()
    assert image.depth[240, 320] == 0.0


def test_depth_has_its_noise_and_its_limits():
    noise = np.random.default_rng(1).standard_normal((200, 200)).astype(np.float32)
    depth = np.full((200, 200), 1.0, dtype=np.float32)
    depth[0], depth[1] = 0.19, 10.5
    measured = measured_depth(depth, noise, 466.0, RgbdModel())
    assert (measured[:2] == 0.0).all()
    assert measured[2:].std() == pytest.approx(0.08 / (466.0 * 0.05), rel=0.05)
    assert np.abs(measured[2:] * 1000 - np.rint(measured[2:] * 1000)).max() < 1e-3


def test_ranges_follow_rep_117():
    true = np.array([0.01, 5.0, 50.0, np.inf])
    model = RangeModel(range_min=0.1, range_max=30.0, sigma=0.01)
    ranges = measured_ranges(true, 0.0, model, np.random.default_rng(1))
    assert ranges[0] == -np.inf
    assert ranges[1] == pytest.approx(5.0, abs=0.05)
    assert (ranges[2:] == np.inf).all()


def test_a_thin_thing_needs_enough_of_the_beam():
    distances = np.full((3, 7), 2.0)
    distances[0, 1] = 1.0  # an edge ray alone: 13 % of the energy
    distances[1, :2] = 1.0  # 35 %
    distances[2, 0] = 1.9  # merges with what is close behind
    ranges = spot_ranges(distances)
    assert ranges[:2] == pytest.approx([2.0, 1.0])
    assert 1.9 < ranges[2] < 2.0


def test_scanners_see_the_ground_plane(simulate):
    simulation = simulate()
    beats(simulation, 20)
    cloud = simulation.drivers.clouds["velodyne"].latest()
    T_map_sensor = simulation.referee.true_pose() @ DESCRIPTION.mounts["velodyne"].T_parent_sensor
    points = transform(T_map_sensor, cloud.points)
    ground = points[np.linalg.norm(points[:, :2] - T_map_sensor[:2, 3], axis=1) < 2.8]
    assert len(ground) > 500
    assert np.abs(np.median(ground[:, 2])) < 0.01
    scan = simulation.drivers.scans["front_laser"].latest()
    assert len(scan.ranges) == 1081
    assert np.isfinite(scan.ranges).sum() > 10


def test_the_scanners_of_robi_look_ahead(simulate):
    simulation = simulate(robot=ROBI)
    beats(simulation, 20)
    cloud = simulation.drivers.clouds["ld_mrs"].latest()
    x, y, z = cloud.points.T
    assert np.degrees(np.abs(np.arctan2(y, x)).max()) < 42.6
    layers, counts = np.unique(np.round(np.degrees(np.arctan2(z, np.hypot(x, y))), 3), return_counts=True)
    assert layers == pytest.approx([-1.2, -0.4, 0.4, 1.2])
    assert counts[0] == counts.max() > 250, "the lowest layer meets the ground most"
    points = transform(simulation.referee.true_pose() @ ROBI.mounts["ld_mrs"].T_parent_sensor, cloud.points)
    assert np.abs(np.median(points[:, 2])) < 0.03, "tilted forward, it sees the ground"
    scan = simulation.drivers.scans["front_laser"].latest()
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    assert np.degrees(angles[[0, -1]]) == pytest.approx([-90.0, 90.0])
    assert (len(scan.ranges), scan.range_max) == (361, 80.0)


def test_a_scanner_that_nobody_simulates_is_refused(simulate):
    mounts = {**DESCRIPTION.mounts, "velodyne": replace(DESCRIPTION.mounts["velodyne"], model="VLP-61")}
    with pytest.raises(InvalidInput, match=r"velodyne: no simulated 'VLP-61'.*did you mean 'VLP-16'"):
        simulate(robot=replace(DESCRIPTION, mounts=mounts))


def test_since_hands_out_every_scan_once(simulate):
    simulation = simulate()
    lidar = simulation.drivers.scans["wrist_lidar"]
    beats(simulation, 50)
    first = lidar.since(0.0)
    assert np.diff([scan.stamp for scan in first]) == pytest.approx(0.066)
    beats(simulation, 20)
    assert [scan.stamp for scan in lidar.since(first[-1].stamp)] == pytest.approx([0.528, 0.594, 0.66])


def test_gnss_is_within_centimetres_of_its_antenna_and_says_so(simulate):
    options = SensorOptions(gnss=GnssOptions(period_s=0.05, errors=GnssModel(float_rate=0.0)))
    simulation = simulate(sensors=options)
    beats(simulation, 190)
    site = simulation.world.site
    antenna = transform(simulation.referee.true_pose(), np.array([-0.35, -0.20, 0.75]))
    fixes = simulation.drivers.gnss.since(0.0)
    errors = np.array(
        [enu_from_geodetic(site.datum, fix.latitude, fix.longitude, fix.altitude) - antenna for fix in fixes]
    )
    assert errors[:, :2].std() == pytest.approx(np.sqrt(fixes[0].covariance[0, 0]), rel=0.35)
    assert np.abs(errors.mean(axis=0)).max() < 0.02
    assert {fix.status for fix in fixes} == {"fix"}


def test_gnss_owns_up_to_a_float_bias(simulate):
    options = SensorOptions(gnss=GnssOptions(period_s=0.1, errors=GnssModel(float_rate=0.0)))
    simulation = simulate(sensors=options)
    beats(simulation, 20)
    simulation.inject(GnssJump(bias=np.array([0.4, 0.0, 0.0]), duration_s=0.3))
    before = simulation.drivers.gnss.latest()
    beats(simulation, 20)
    jumped = simulation.drivers.gnss.since(before.stamp)[0]
    assert jumped.status == "float"
    assert (jumped.longitude - before.longitude) * 111_320 * np.cos(np.radians(42.3)) == pytest.approx(0.4, abs=0.1)
    assert np.sqrt(jumped.covariance[0, 0]) > 0.15
    beats(simulation, 30)
    assert simulation.drivers.gnss.latest().status == "fix"


def test_gnss_may_be_wrong_and_not_know_it(simulate):
    options = SensorOptions(gnss=GnssOptions(period_s=0.1, errors=GnssModel(float_rate=0.0)))
    simulation = simulate(sensors=options)
    beats(simulation, 20)
    before = simulation.drivers.gnss.latest()
    simulation.inject(GnssJump(bias=np.array([0.4, 0.0, 0.0]), duration_s=0.3, wrong_fix=True))
    beats(simulation, 20)
    jumped = simulation.drivers.gnss.since(before.stamp)[0]
    assert jumped.status == "fix" and jumped.covariance[0, 0] == before.covariance[0, 0]
    assert (jumped.longitude - before.longitude) * 111_320 * np.cos(np.radians(42.3)) == pytest.approx(0.4, abs=0.1)


def test_float_spells_come_at_their_rate():
    model = GnssModel()
    spells = float_spells(model, np.random.default_rng(2), until_s=200_000.0)
    assert len(spells) == pytest.approx(200_000 / (200 + 17.5), rel=0.1)
    assert all(5.0 <= spell.end - spell.start <= 30.0 for spell in spells)
    assert all(0.05 <= np.linalg.norm(spell.bias[:2]) <= 0.5 for spell in spells)


def test_the_imu_at_rest_feels_gravity_and_knows_its_heading(simulate):
    simulation = simulate()
    beats(simulation, 150)
    messages = simulation.drivers.imu.since(0.5)
    force = np.mean([m.linear_acceleration for m in messages], axis=0)
    assert force == pytest.approx([0.0, 0.0, 9.81], abs=0.05)
    truth = yaw_of(simulation.referee.true_pose())
    yaws = np.array([yaw_of(quaternion_to_rotation(m.orientation)) - truth for m in messages])
    assert 0.001 < yaws.std() < 0.02
    assert np.abs(yaws).max() < 0.05
    assert np.abs(np.mean([m.angular_velocity for m in messages], axis=0)).max() < 0.003


def test_slow_drift_has_its_standard_deviation():
    values = np.array([SlowDrift(np.random.default_rng(k), 0.02, 8).at(100.0) for k in range(300)])
    assert values.std() == pytest.approx(0.02, rel=0.1)


def test_noise_depends_on_the_frame_alone():
    one, other = FrameNoise(1, "x"), FrameNoise(1, "x")
    one.normal(999, 4)
    assert (one.normal(5, 4) == other.normal(5, 4)).all()
    assert (one.frame(5).random(3) == other.frame(5).random(3)).all()
    assert (FrameNoise(1, "y").normal(5, 4) != one.normal(5, 4)).all()
    assert (FrameNoise(2, "x").normal(5, 4) != one.normal(5, 4)).all()
