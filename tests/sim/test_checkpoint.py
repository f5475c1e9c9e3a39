"""The world in a folder: what is brought back goes on as if nothing had happened, and a torn write does no harm."""

import json
import struct

import numpy as np
import pytest

from grape.errors import InvalidInput, StaleData
from grape.geodesy import enu_from_geodetic
from grape.geometry import pose, transform
from grape.messages import Odometry
from grape.sim.checkpoint import JOURNAL_FILE, STATE_FILE, TwoSlots, kept_time, newest
from grape.sim.faults import CameraGlare, FreezeSensor, GnssJump
from grape.sim.sensors.rgbd import Glare


def command(simulation, beat):
    drivers = simulation.drivers
    drivers.base.send(0.4, 0.3 * np.sin(beat / 30))
    drivers.arm.send(0.1 * np.cos(np.arange(6) + beat / 20))
    drivers.gripper.send([0.5, 0.6, 0.6])


def go(simulation, first, last):
    for beat in range(first, last):
        command(simulation, beat)
        six = np.zeros((6, 6))
        estimate = Odometry(
            stamp=beat / 100, frame_id="map", child_frame_id="base_link", pose=np.eye(4),
            linear=np.zeros(3), angular=np.zeros(3), pose_covariance=six, twist_covariance=six,
        )  # fmt: skip
        simulation.referee.observe(estimate)
        simulation.advance()


def told(simulation):
    """What sensors and the referee say; of the newest samples only."""
    drivers = simulation.drivers
    sensors = (
        drivers.base, drivers.arm, drivers.gripper, drivers.imu, drivers.gnss, drivers.camera,
        *drivers.scans.values(), *drivers.clouds.values(),
    )  # fmt: skip
    messages = [sensor.latest() for sensor in sensors]
    arrays = [v.tobytes() for m in messages for v in vars(m).values() if isinstance(v, np.ndarray)]
    return arrays, simulation.referee.verdict()["truth"]


def test_a_world_that_was_brought_back_goes_on_to_the_last_bit(simulate, tmp_path):
    whole = simulate(seed=5, dispensers=2)
    go(whole, 0, 130)
    killed = simulate(seed=5, dispensers=2)
    assert not killed.keep(tmp_path / "world")
    go(killed, 0, 17)
    resumed = simulate(seed=5, dispensers=2)
    assert resumed.keep(tmp_path / "world")
    assert resumed.clock.step == 85 and kept_time(tmp_path / "world") == pytest.approx(0.17)
    assert resumed._physics.data.qpos.tobytes() == killed._physics.data.qpos.tobytes()
    go(resumed, 17, 130)
    assert resumed._physics.data.qpos.tobytes() == whole._physics.data.qpos.tobytes()
    assert resumed._physics.data.qvel.tobytes() == whole._physics.data.qvel.tobytes()
    assert told(resumed) == told(whole)
    # MuJoCo's poses lag the state by one step, which is not kept: the first look after coming back is 2 ms ahead.
    one, two = resumed.referee.verdict()["localization"], whole.referee.verdict()["localization"]
    assert one == pytest.approx(two, abs=1e-4)
    assert [sample.time_s for sample in resumed.referee.path] == [sample.time_s for sample in whole.referee.path]


def test_a_world_that_was_brought_back_tells_nothing_of_the_start_of_its_site(simulate, tmp_path):
    first = simulate()
    first.keep(tmp_path / "world")
    first.inject(FreezeSensor(name="gnss"))
    go(first, 0, 60)
    again = simulate()
    again.keep(tmp_path / "world")
    ports = again.drivers
    sensors = (ports.base, ports.imu, ports.gnss, ports.camera, *ports.scans.values(), *ports.clouds.values())
    assert [sensor.since(-1.0) for sensor in sensors] == [()] * len(sensors)
    go(again, 60, 80)
    assert min(message.stamp for message in ports.imu.since(-1.0)) > 0.6
    with pytest.raises(StaleData, match="nothing measured yet"):
        ports.gnss.latest()


def test_unattended_actuators_come_to_rest(simulate, tmp_path):
    first = simulate()
    first.keep(tmp_path / "world")
    go(first, 0, 60)
    again = simulate()
    again.keep(tmp_path / "world")
    assert np.abs(again._physics.data.qvel[:6]).max() > 0.1
    for _ in range(150):
        again.advance()
    assert np.abs(again._physics.data.qvel).max() < 0.02


def test_faults_last_and_so_do_the_referees_findings(simulate, tmp_path):
    first = simulate()
    first.keep(tmp_path / "world")
    first.inject(FreezeSensor(name="imu"))
    first.inject(GnssJump(bias=np.array([0.4, 0.0, 0.0]), duration_s=30.0))
    first.inject(CameraGlare(glare=Glare(u=320, v=240, radius=40)))
    go(first, 0, 60)
    again = simulate()
    again.keep(tmp_path / "world")
    go(again, 60, 161)
    assert again._drivers.imu._frozen and again._drivers.camera.errors.glare == Glare(u=320, v=240, radius=40)
    assert again.drivers.gnss.latest().status == "float"
    times = [sample.time_s for sample in again.referee.path]
    assert times[0] == 0.0 and times[-1] >= 1.4 and times == sorted(times)


def test_planned_faults_begin_at_their_time_and_never_twice(simulate, tmp_path):
    jump = GnssJump(bias=np.array([0.4, 0.0, 0.0]), duration_s=30.0, wrong_fix=True)
    planned = ((0.3, FreezeSensor(name="imu", frozen=False)), (0.1, FreezeSensor(name="imu")), (0.4, jump))
    first = simulate(faults=planned)
    first.keep(tmp_path / "world")
    go(first, 0, 20)
    assert first._drivers.imu._frozen
    go(first, 20, 45)
    assert not first._drivers.imu._frozen
    again = simulate(faults=planned)
    again.keep(tmp_path / "world")
    go(again, 45, 161)
    assert not again._drivers.imu._frozen
    fix, base = again.drivers.gnss.latest(), again._physics.data.body("base_link")
    T_map_base = pose(base.xmat.reshape(3, 3), base.xpos)
    antenna = transform(T_map_base, again.robot.T_base_link_sensor("gnss_link")[:3, 3])
    told = enu_from_geodetic(again.world.site.datum, fix.latitude, fix.longitude, fix.altitude)
    assert told[0] - antenna[0] == pytest.approx(0.4, abs=0.3) and fix.status == "fix"


def test_collisions_keep_their_first_time_and_largest_force(simulate, tmp_path):
    first = simulate()
    first.keep(tmp_path / "world")
    command(first, 0)
    arm = first._physics.joint_qpos(first.robot.arm.joints)
    first._physics.data.qpos[arm[1]] += 1.5  # down onto the deck
    for _ in range(3):
        first.advance()
    found = first.referee.collisions
    assert found, "the arm is in the deck"
    again = simulate()
    again.keep(tmp_path / "world")
    assert again.referee.collisions == found


def test_a_torn_write_leaves_the_one_before(tmp_path):
    path = tmp_path / "slots"
    slots = TwoSlots(path, 8, 7)
    for value in (1.0, 2.0, 3.0):
        slots.write(memoryview(struct.pack("<d", value)))
    assert newest(path) == (7, struct.pack("<d", 3.0))
    content = bytearray(path.read_bytes())
    content[content.index(struct.pack("<d", 3.0)) + 6] ^= 0xFF
    path.write_bytes(content)
    assert newest(path) == (7, struct.pack("<d", 2.0))
    path.write_bytes(bytes(len(content)))
    assert newest(path) is None
    assert newest(tmp_path / "none") is None


def test_what_is_newer_than_the_state_is_taken_out_of_the_journal(simulate, tmp_path):
    first = simulate()
    first.keep(tmp_path / "world")
    go(first, 0, 45)
    journal = tmp_path / "world" / JOURNAL_FILE
    before = journal.read_text()
    with journal.open("a") as file:
        file.write(json.dumps({"step": 10**6, "kind": "PathSample", "time_s": 1.0, "x": 0, "y": 0, "yaw": 0}) + "\n")
        file.write('{"step": 3, "ki')
    again = simulate()
    again.keep(tmp_path / "world")
    assert journal.read_text() == before and again.referee.path == first.referee.path


def test_another_world_is_refused(simulate, tmp_path):
    simulate().keep(tmp_path / "world")
    with pytest.raises(InvalidInput, match="another world"):
        simulate(dispensers=1).keep(tmp_path / "world")
    with pytest.raises(InvalidInput, match="another world"):
        simulate(slope=0.1).keep(tmp_path / "world")
    assert (tmp_path / "world" / STATE_FILE).stat().st_size > 0
