from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import inverse, pose, rotation_from_rpy, rotation_log, rotation_to_rpy
from grape.localization import Mount, Reading, Sensor, SensorOptions, components, per_component, reading_of_components
from grape.localization import reading_of_message as of_message
from grape.messages import Imu, Odometry, PoseStamped, Twist

TURNED = pose(rotation_from_rpy(0.0, -np.pi / 2, np.pi), (0.19, 0.0, 0.149))
EVERY = per_component(**dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), 0.1))


def pose_reading(stamp: float, T: np.ndarray) -> Reading:
    return of_message("laser", PoseStamped(stamp=stamp, frame_id="map", pose=T))


def test_attitude_is_that_of_the_base_whatever_the_mount():
    R = rotation_from_rpy(0.1, -0.2, 1.5)
    options = SensorOptions(
        components=components("roll", "pitch", "yaw"), mount=Mount(T_base_sensor=TURNED), std=EVERY, yaw_offset=0.3
    )
    rpy = rotation_to_rpy(R @ TURNED[:3, :3])
    (m,) = Sensor("imu", options).measurements(reading_of_components(0.0, "imu", roll=rpy[0], pitch=rpy[1], yaw=rpy[2]))
    assert np.allclose(m.value, [0.1, -0.2, 1.8])


def test_differential_poses_become_velocities_along_the_sensors_axes():
    options = SensorOptions(components=components("x", "y", "z", "roll", "pitch", "yaw"), std=EVERY, differential=True)
    sensor = Sensor("laser", options)
    A = pose(rotation_from_rpy(0.1, 0.2, 2.0), (1.0, 2.0, 3.0))
    B = A @ pose(rotation_from_rpy(0.0, 0.0, 0.05), (0.1, 0.02, 0.0))
    assert sensor.measurements(pose_reading(1.0, A)) == []
    (still,) = sensor.measurements(pose_reading(1.5, A))
    assert np.allclose(np.sqrt(still.covariance.diagonal()), np.sqrt(2) * 0.1 / 0.5)
    twist = per_component(vx=0.1, vy=0.1, vz=0.1, wx=0.1, wy=0.1, wz=0.1)
    sensor = Sensor("laser", SensorOptions(components=options.components, std=twist, differential=True))
    sensor.measurements(pose_reading(1.0, A))
    (m,) = sensor.measurements(pose_reading(1.1, B))
    assert m.stamp == pytest.approx(1.05)
    assert list(m.index) == [6, 7, 8, 9, 10, 11]
    assert np.allclose(m.value, np.r_[1.0, 0.2, 0.0, rotation_log((inverse(A) @ B)[:3, :3]) / 0.1])
    with pytest.raises(InvalidInput, match="increase"):
        sensor.measurements(pose_reading(1.1, B))


def test_differential_sensor_survives_a_late_stamp_and_time_that_starts_over():
    twist = per_component(vx=0.1, vy=0.1, vz=0.1, wx=0.1, wy=0.1, wz=0.1)
    sensor = Sensor("laser", SensorOptions(components=components("x", "y", "yaw"), std=twist, differential=True))

    def speeds(stamp: float, x: float) -> np.ndarray:
        return sensor.measurements(pose_reading(stamp, pose(None, (x, 0.0, 0.0))))[0].value

    sensor.measurements(pose_reading(100.0, np.eye(4)))
    with pytest.raises(InvalidInput, match="increase"):
        speeds(99.9, 5.0)
    assert speeds(100.1, 0.1)[0] == pytest.approx(1.0)
    with pytest.raises(InvalidInput, match="increase"):
        speeds(0.0, 7.0)
    assert speeds(0.1, 7.05)[0] == pytest.approx(0.5)


@pytest.mark.parametrize("relative", [False, True])
def test_a_pose_of_which_one_angle_is_none_says_nothing(relative):
    chosen = components("x", "yaw")
    sensor = Sensor(
        "laser", SensorOptions(components=chosen, std=EVERY, relative=relative, mount=Mount(T_base_sensor=TURNED))
    )
    values = {"x": 3.0, "y": 0.0, "z": 0.0, "roll": np.nan, "pitch": 0.0, "yaw": 1.0}
    (m,) = sensor.measurements(reading_of_components(0.0, "laser", **values))
    assert not m.usable


def test_noise_that_nobody_knows_is_an_error():
    options = SensorOptions(components=components("x", "y"), std=per_component(x=0.1))
    with pytest.raises(InvalidInput, match="how good y"):
        Sensor("place", options).measurements(reading_of_components(0.0, "place", x=1.0, y=2.0))


def test_relative_poses_begin_where_the_base_begins():
    mount = Mount(T_base_sensor=pose(rotation_from_rpy(0.0, 0.0, 0.5), (0.3, 0.1, 0.0)))
    options = SensorOptions(components=components("x", "y", "yaw"), mount=mount, std=EVERY, relative=True)
    sensor = Sensor("laser", options)
    T_frame_base = pose(rotation_from_rpy(0.0, 0.0, 1.0), (7.0, -3.0, 0.0))
    moved = pose(rotation_from_rpy(0.0, 0.0, 0.2), (1.0, 0.5, 0.0))
    sensor.measurements(pose_reading(0.0, T_frame_base @ mount.T_base_sensor))
    (m,) = sensor.measurements(pose_reading(1.0, T_frame_base @ moved @ mount.T_base_sensor))
    assert m.value[2] == pytest.approx(0.2)
    T_world_sensor = m.mount.T_world_frame @ pose(None, (*m.value[:2], 0.0))
    assert np.allclose(T_world_sensor[:3, 3], (moved @ mount.T_base_sensor)[:3, 3])


def test_noise_grows_with_speed_and_turning_and_never_falls_below_the_least():
    options = SensorOptions(
        components=components("vx", "wz"),
        std=per_component(vx=0.02),
        least_std=per_component(wz=0.3),
        std_per_speed=per_component(vx=0.1),
        std_per_turn=per_component(vx=0.5),
    )
    twist = Odometry(
        stamp=0.0,
        child_frame_id="base_link",
        pose=np.eye(4),
        linear=np.array([0.5, 0.0, 0.0]),
        angular=np.array([0.0, 0.0, -0.2]),
        pose_covariance=np.zeros((6, 6)),
        twist_covariance=np.eye(6) * 0.01,
    )
    (m,) = Sensor("odom", options).measurements(of_message("odom", twist))
    assert np.allclose(np.sqrt(m.covariance.diagonal()), [0.02 + 0.05 + 0.1, 0.3])


def test_each_part_has_its_gate_and_float_fixes_count_less():
    options = SensorOptions(
        components=components("x", "yaw", "wz", "ax"), std=per_component(x=0.1, yaw=0.1, wz=0.1, ax=0.1), pose_gate=3.0
    )
    reading = Reading(stamp=0.0, sensor="a", values=np.zeros(15), given=np.ones(15), status="float")
    pose_part, twist_part, force_part = Sensor("a", options).measurements(reading)
    assert (pose_part.gate, twist_part.gate, force_part.gate) == (3.0, np.inf, np.inf)
    assert pose_part.covariance[0, 0] == pytest.approx(0.3**2)


def test_wheels_at_rest_say_that_the_base_stands():
    options = SensorOptions(components=components("vx", "wz"), std=per_component(vx=0.02, wz=0.1), still_below=0.003)
    (m,) = Sensor("wheels", options).measurements(reading_of_components(0.0, "wheels", vx=0.001, wz=0.0))
    assert list(m.index) == [6, 7, 8, 9, 10, 11] and not m.value.any()


def test_messages_keep_their_numbers():
    imu = Imu(
        stamp=1.0,
        orientation=np.array([1.0, 0, 0, 0]),
        angular_velocity=np.array([0.1, 0.2, 0.3]),
        linear_acceleration=np.array([1.0, 2.0, 9.0]),
    )
    reading = of_message("imu", imu)
    assert np.allclose(reading.values[9:], [0.1, 0.2, 0.3, 1, 2, 9]) and not reading.given[:3].any()
    twist = of_message("radar", Twist(stamp=1.0, linear=np.array([1.0, 0, 0]), angular=np.zeros(3)))
    assert list(np.flatnonzero(twist.given)) == [6, 7, 8, 9, 10, 11]


@pytest.mark.parametrize(
    "wrong",
    [
        {"components": (True,) * 14},
        {"std": np.full(15, -1.0)},
        {"std": np.zeros(15)},
        {"pose_gate": 0.0},
        {"differential": True, "relative": True},
        {"delay_s": -1.0},
        {"components": components("wx", "wy", "wz"), "still_below": 0.01},
    ],
)
def test_options_that_mean_nothing_are_refused(wrong):
    with pytest.raises(InvalidInput):
        SensorOptions(**{"components": components("x"), **wrong})


def test_misspelt_component_is_named():
    with pytest.raises(InvalidInput, match="vxx"):
        per_component(vxx=1.0)
    with pytest.raises(InvalidInput, match="yow"):
        reading_of_components(0.0, "a", yow=1.0)
