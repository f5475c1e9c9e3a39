"""The loop dispenser: its shape, and that the real arm takes one from the feeder by contact alone."""

import mujoco
import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import interpolate, inverse, pose
from grape.kinematics import ArmModel, HandModel, inverse_all, inverse_path
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.dispenser import DispenserOptions, LoopReader, add_dispenser, place_dispenser

pytestmark = pytest.mark.filterwarnings("ignore:Attaching a spec")


def floating_loop(**options):
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.gravity = [0, 0, 0]
    add_dispenser(spec, "dispenser_0", options=DispenserOptions(**options))
    model = spec.compile()
    return model, mujoco.MjData(model)


def test_a_relaxed_loop_has_the_measured_size_and_mass():
    model, data = floating_loop()
    mujoco.mj_forward(model, data)
    line = LoopReader.of(model, "dispenser_0").polyline(data)
    assert line.shape == (2 * DispenserOptions().segments + 1, 3)
    np.testing.assert_allclose(np.ptp(line, axis=0), (0.029, 0.140, 0.0), atol=2e-4)
    assert model.body_mass.sum() == pytest.approx(0.003, abs=1e-4)


def test_a_loop_stays_closed_and_relaxed_where_nothing_touches_it():
    model, data = floating_loop()
    for _ in range(250):
        mujoco.mj_step(model, data)
    gap = data.site("dispenser_0_end").xpos - data.site("dispenser_0_join").xpos
    assert np.linalg.norm(gap) < 1e-4
    assert np.ptp(LoopReader.of(model, "dispenser_0").polyline(data)[:, 0]) == pytest.approx(0.029, abs=5e-4)


def test_placing_a_loop_puts_its_centre_there_and_stops_it():
    model, data = floating_loop()
    data.qvel[:] = 1.0
    data.qpos[10:] = 0.1
    there = pose(translation=(1.0, 2.0, 3.0))
    place_dispenser(model, data, "dispenser_0", there)
    mujoco.mj_forward(model, data)
    line = LoopReader.of(model, "dispenser_0").polyline(data)
    np.testing.assert_allclose(0.5 * (line.min(axis=0) + line.max(axis=0)), (1.0, 2.0, 3.0), atol=1e-6)
    assert not data.qvel.any()


def test_two_loops_in_one_scene_keep_their_names_apart():
    spec = mujoco.MjSpec()
    for k in range(2):
        add_dispenser(spec, f"dispenser_{k}", pose(translation=(k, 0.0, 0.0)))
    model = spec.compile()
    first, second = (LoopReader.of(model, f"dispenser_{k}") for k in range(2))
    assert not first.subtree & second.subtree
    assert model.neq == 2


@pytest.mark.parametrize("options", [{"segments": 1}, {"mass": 0.0}, {"out_of_plane_every": 0}])
def test_impossible_loops_are_refused(options):
    with pytest.raises(InvalidInput, match="a dispenser needs"):
        DispenserOptions(**options)


class Arm:
    """The simulated arm, driven by joint set-points at 100 Hz along straight lines of the nails."""

    def __init__(self, loops):
        spec = mujoco.MjSpec.from_file(str(DESCRIPTION.mjcf))
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1], contype=1, conaffinity=4)
        for k in range(loops):
            add_dispenser(spec, f"dispenser_{k}")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.arm, self.hand = ArmModel.from_mjcf(DESCRIPTION.mjcf), HandModel(DESCRIPTION.gripper)
        self.finger = DESCRIPTION.gripper.closed_angle

    def start(self, T_arm_nails):
        T_hand = T_arm_nails @ inverse(self.hand.T_hand_nails(self.finger))
        self.q = inverse_all(self.arm, T_hand, DESCRIPTION.arm.poses["ready_feeder"])[0].q
        self.nails = T_arm_nails
        joints = (*DESCRIPTION.arm.joints, *DESCRIPTION.gripper.joints)
        values = (*self.q, DESCRIPTION.gripper.thumb_clear, self.finger, self.finger)
        for joint, value in zip(joints, values, strict=True):
            self.data.joint(joint).qpos = value
        mujoco.mj_forward(self.model, self.data)
        for k in range(self.model.neq):
            base = self.data.body("base_link").xpos
            level = pose(translation=base) @ DESCRIPTION.feeder.T_base_link_level(k)
            place_dispenser(self.model, self.data, f"dispenser_{k}", level)
        self.move(T_arm_nails, 0.3)

    def move(self, T_arm_nails, seconds, finger=None):
        start, first, last = self.nails, self.finger, self.finger if finger is None else finger
        shares = [s**3 * (10 - 15 * s + 6 * s * s) for s in np.linspace(0, 1, round(seconds * 100) + 1)[1:]]
        angles = [first + (last - first) * s for s in shares]
        hands = [
            interpolate(start, T_arm_nails, s) @ inverse(self.hand.T_hand_nails(angle))
            for s, angle in zip(shares, angles, strict=True)
        ]
        for q, angle in zip(inverse_path(self.arm, np.array(hands), self.q), angles, strict=True):
            lead = q + DESCRIPTION.arm.servo_lag * (q - self.q) / 0.01
            self.data.ctrl[4:10], self.data.ctrl[10:13] = lead, (DESCRIPTION.gripper.thumb_clear, angle, angle)
            self.q = q
            for _ in range(5):
                mujoco.mj_step(self.model, self.data)
        self.nails, self.finger = T_arm_nails, last


def test_the_arm_takes_the_upper_loop_from_the_feeder_by_contact():
    robot, gripper = Arm(loops=2), DESCRIPTION.gripper
    level = inverse(DESCRIPTION.arm.T_base_link_arm_base) @ DESCRIPTION.feeder.T_base_link_level(1)
    at = lambda x, z: pose(translation=level[:3, 3] + (x, 0.0, z - 0.0015))  # noqa: E731
    robot.start(at(0.0, 0.10))
    readers = [LoopReader.of(robot.model, f"dispenser_{k}") for k in range(2)]
    lower = readers[0].polyline(robot.data)
    robot.move(at(0.0, 0.0), 2.0)
    robot.move(at(0.0, 0.0), 1.5, gripper.open_angle)
    robot.move(at(-0.024, 0.0), 0.8)
    robot.move(at(-0.024, 0.12), 1.2)
    robot.move(at(-0.024, 0.12), 0.3)
    touched = {robot.model.body(body).name for body in readers[1].touches(robot.model, robot.data)}
    assert touched == set(gripper.nail_bodies)
    middle = 0.5 * sum(robot.data.body(name).xpos for name in gripper.nail_bodies)
    assert np.linalg.norm(readers[1].polyline(robot.data).mean(axis=0) - middle) < 0.02
    assert np.abs(readers[0].polyline(robot.data) - lower).max() < 1e-3
