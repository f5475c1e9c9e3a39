"""The scene as a whole: time, determinism, faults, pictures."""

import numpy as np
import pytest

from grape.errors import DriverError, InvalidInput
from grape.messages import Message
from grape.sim.drivers.sampled import SampledSensor
from grape.sim.faults import FreezeSensor
from grape.sim.physics import STEP_S
from grape.sim.render import Renderer


def drive_and_move(simulation, beats, read_every):
    """Commands that depend on the beat alone; reads now and then, and everything at the end."""
    drivers = simulation.drivers
    for beat in range(beats):
        drivers.base.send(0.4, 0.3 * np.sin(beat / 30))
        drivers.arm.send(0.1 * np.cos(np.arange(6) + beat / 20))
        drivers.gripper.send([0.5, 0.6, 0.6])
        simulation.advance()
        if beat % read_every == 0:
            drivers.scans["wrist_lidar"].latest()
            drivers.imu.latest()
    return [
        drivers.base.latest(),
        drivers.arm.latest(),
        drivers.gripper.latest(),
        drivers.camera.latest(),
        *drivers.imu.since(0.0),
        drivers.gnss.latest(),
        *drivers.scans["wrist_lidar"].since(0.0),
        drivers.scans["front_laser"].latest(),
        drivers.clouds["velodyne"].latest(),
    ]


def content(message: Message) -> list[bytes]:
    return [
        value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
        for name, value in sorted(vars(message).items())
        if name != "info"
    ]


def test_the_same_seed_and_commands_give_the_same_bytes_whoever_reads(simulate):
    one, two = simulate(seed=5, dispensers=2), simulate(seed=5, dispensers=2)
    seen_one, seen_two = drive_and_move(one, 60, read_every=1), drive_and_move(two, 60, read_every=13)
    assert one._physics.data.qpos.tobytes() == two._physics.data.qpos.tobytes()
    assert [content(message) for message in seen_one] == [content(message) for message in seen_two]


def test_another_seed_gives_other_noise_and_the_same_motion(simulate):
    one, two = simulate(seed=5), simulate(seed=6)
    for _ in range(20):
        one.advance()
        two.advance()
    assert one._physics.data.qpos.tobytes() == two._physics.data.qpos.tobytes()
    assert (one.drivers.arm.latest().position != two.drivers.arm.latest().position).all()


def test_time_is_counted_in_whole_steps(simulate):
    simulation = simulate()
    for _ in range(7):
        simulation.advance(13)
    assert simulation.clock.now() == 7 * 13 / 500
    assert pytest.approx(0.002) == STEP_S


def test_every_sensor_keeps_its_period(simulate):
    simulation = simulate()
    for _ in range(210):
        simulation.advance()
    periods = {
        "base": 0.02,
        "arm": 0.01,
        "gripper": 0.01,
        "imu": 0.02,
        "gnss": 1.0,
        "wrist_lidar": 0.066,
        "front_laser": 0.026,
        "velodyne": 0.1,
    }
    for name, period in periods.items():
        sensor: SampledSensor = simulation._drivers.sensors[name]
        stamps = [slot.stamp for slot in sensor._slots]
        assert np.diff(stamps) == pytest.approx(period), name
        assert simulation.clock.now() - stamps[0] >= 1.9


@pytest.mark.parametrize("speed", [np.nan, np.inf, 1e7])
def test_a_state_that_diverges_ends_the_mission(simulate, speed):
    simulation = simulate()
    simulation._physics.data.qvel[0] = speed
    with pytest.raises(DriverError, match="diverged"):
        simulation.advance()
    with pytest.raises(DriverError, match="diverged"):
        simulation.advance()


def test_a_misspelt_sensor_is_refused_with_a_suggestion(simulate):
    with pytest.raises(InvalidInput, match="did you mean 'velodyne'"):
        simulate().inject(FreezeSensor(name="velodyn"))


def test_pictures_show_the_robot(simulate):
    simulation = simulate(dispensers=1)
    picture = simulation.render(width=320, height=240)
    assert picture.shape == (240, 320, 3)
    r, g, b = (picture[..., k].astype(int) for k in range(3))
    assert ((r > 150) & (g > 100) & (b < 80)).sum() > 100, "the yellow deck"
    assert simulation.render("wrist_camera", 320, 240).std() > 5


def test_a_picture_that_is_too_large_is_refused(simulate):
    with pytest.raises(InvalidInput, match="at most"):
        Renderer(simulate()._physics.model, 5000, 100)


def test_an_unknown_camera_is_refused(simulate):
    with pytest.raises(InvalidInput, match="wrist_camera"):
        simulate().render("nose", 64, 64)
