"""What the referee sees of scenes that are set up by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from grape.geometry import pose, rotation_z
from grape.kinematics import ArmModel
from grape.messages import Odometry
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.robots.robi_jaco2 import DESCRIPTION as ROBI
from grape.sim.areas import contains, passes_through, polygons_touch
from grape.sim.compose import BASE_JOINT, compose
from grape.sim.faults import DropDispenser
from grape.sim.parts import Part, PartTable
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import WalkerOptions
from grape.sim.worlds.model import Label
from tests.sim.conftest import over, place, small_world


def beats(simulation, count, estimate=None):
    for _ in range(count):
        simulation.advance()
        simulation.referee.observe(estimate)


def move_base(simulation, x, y, yaw=0.0):
    physics = simulation._physics
    address = physics.model.joint(BASE_JOINT).qposadr[0]
    physics.data.qpos[address : address + 2] = x, y
    physics.data.qpos[address + 3 : address + 7] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
    mujoco.mj_forward(physics.model, physics.data)


def truth(simulation):
    return simulation.referee.verdict()["truth"]


def test_loops_that_nobody_touched_are_in_the_feeder(simulate):
    simulation = simulate(dispensers=3)
    beats(simulation, 30)
    found = truth(simulation)
    assert (found["in_feeder"], found["dropped"], found["on_hand"]) == (3, 0, 0)
    assert found["hanging"] == [] and found["collisions"] == []


def test_a_loop_on_a_nail_hangs(simulate):
    simulation = simulate(dispensers=2)
    nail = simulation.world.nails[0]
    place(simulation, 0, over(nail.tip, nail.base))
    beats(simulation, 150)
    found = truth(simulation)
    assert found["hanging"] == [nail.id]
    assert found["plants"][nail.id]["hanging"] is True
    assert found["plants"][nail.id]["offset_mm"] < 80
    assert found["in_feeder"] == 1 and found["dropped"] == 0


def test_a_loop_on_an_upright_spur_hangs(simulate):
    simulation = simulate(dispensers=1)
    spur = max(simulation.world.spurs, key=lambda spur: spur.direction[2])
    place(simulation, 0, over(spur.tip, spur.base))
    beats(simulation, 200)
    assert truth(simulation)["hanging"] == [spur.plant]


def test_a_loop_that_has_slid_down_an_arm_hangs(simulate):
    simulation = simulate(dispensers=1, style="gobelet")
    arm = max(
        (rod for rod in simulation.world.capsules if rod.label is Label.ARM and "/arm" in rod.name),
        key=lambda rod: rod.p1[2],
    )
    place(simulation, 0, over(arm.p1, arm.p0))
    beats(simulation, 200)
    assert truth(simulation)["hanging"] == [arm.plant]


def test_a_loop_beside_the_spur_does_not_hang(simulate):
    simulation = simulate(dispensers=1)
    spur = max(simulation.world.spurs, key=lambda spur: spur.direction[2])
    place(simulation, 0, pose(np.eye(3), np.add(spur.tip, [0.0, -0.4, 0.0])))
    beats(simulation, 150)
    found = truth(simulation)
    assert found["hanging"] == [] and found["dropped"] == 1


def test_a_loop_still_falling_does_not_hang(simulate):
    simulation = simulate(dispensers=1)
    nail = simulation.world.nails[0]
    place(simulation, 0, pose(np.eye(3), np.add(nail.tip, [0.0, 0.0, 1.0])))
    beats(simulation, 5)
    assert truth(simulation)["hanging"] == []


def test_a_dropped_dispenser_counts_as_dropped(simulate):
    simulation = simulate(dispensers=2)
    simulation.inject(DropDispenser(index=1))
    beats(simulation, 60)
    found = truth(simulation)
    assert (found["in_feeder"], found["dropped"]) == (1, 1)


def test_what_was_so_at_a_look_of_the_robot_is_remembered(simulate):
    simulation = simulate(dispensers=1)
    referee, nail = simulation.referee, simulation.world.nails[0]
    beats(simulation, 5)
    for check in ("feeder", "grasp", "deployment", "weather"):
        referee.witness(check, nail.id)
    place(simulation, 0, over(nail.tip, nail.base))
    beats(simulation, 150)
    assert truth(simulation)["hanging"] == [nail.id]
    for check, plant in (("feeder", nail.id), ("deployment", nail.id), ("deployment", "r0v0")):
        referee.witness(check, plant)
    looks = truth(simulation)["checks"]
    assert [look["true"] for look in looks] == [True, False, False, None, False, True, False]
    assert (looks[0]["in_feeder"], looks[5]["in_feeder"], looks[5]["hanging"]) == (1, 0, True)
    assert [look["level"] for look in looks] == [0, 0, 0, 0, None, None, None]
    assert looks[0]["places"] == {"dropped": 0, "feeder": 1, "hand": 0, "stock": 0}
    assert (
        looks[5]["places"]
        == {"dropped": 0, "feeder": 0, "hand": 0, "stock": 0, nail.id: 1}
        == truth(simulation)["places"]
    )
    assert looks[5]["time_s"] == pytest.approx(simulation.clock.now()) and looks[5]["plant"] == nail.id


def test_the_level_on_top_is_that_of_the_highest_loop_in_the_feeder(simulate):
    simulation = simulate(dispensers=4)
    referee = simulation.referee
    beats(simulation, 20)
    referee.witness("feeder", "")
    for index in (3, 1):
        simulation.inject(DropDispenser(index=index))
        beats(simulation, 20)
        referee.witness("feeder", "")
    looks = truth(simulation)["checks"]
    assert [(look["level"], look["in_feeder"]) for look in looks] == [(3, 4), (2, 3), (2, 2)]


def test_driving_into_a_post_is_a_collision_with_its_force_and_time(simulate):
    simulation = simulate()
    post = next(piece for piece in simulation.world.capsules if "post" in piece.name)
    move_base(simulation, post.p0[0] - 0.8, post.p0[1])
    beats(simulation, 20)
    before = simulation.clock.now()
    for _ in range(120):
        simulation.drivers.base.send(0.4, 0.0)
        beats(simulation, 1)
    found = truth(simulation)
    hit = next(c for c in found["collisions"] if c["b"] == post.name)
    assert hit["a"] == "base_link"
    assert hit["force_n"] > 30 and hit["time_s"] > before
    assert found["max_plant_force_n"] >= hit["force_n"]


def test_nails_may_touch_plants_and_how_hard_is_measured(simulate):
    parts = simulate(dispensers=1).referee._parts
    plant, nail, arm, loop = (
        int(np.flatnonzero(parts.kinds == kind)[0]) for kind in (Part.PLANT, Part.NAIL, Part.ARM, Part.DISPENSER)
    )
    pairs = np.array([[nail, plant], [plant, nail], [arm, plant], [loop, plant], [loop, nail]])
    assert parts.force_counts(pairs).tolist() == [True, True, True, False, False]
    assert [parts.forbidden(a, b) for a, b in pairs] == [False, False, True, False, False]


def test_the_arm_in_the_deck_is_a_collision_with_itself(simulate):
    simulation = simulate()
    arm = simulation.drivers.arm
    down = -0.5 * np.sign(ArmModel.from_mjcf(DESCRIPTION.mjcf).jacobian(arm.latest().position)[2]) * [0, 1, 0, 0, 0, 0]
    for _ in range(500):
        arm.send(down)
        beats(simulation, 1)
        if simulation.referee.collisions:
            break
    moving = ("link", "hand", "finger", "wrist", "nail")
    assert simulation.referee.collisions
    assert all(any(part in c.a + c.b for part in moving) for c in simulation.referee.collisions)
    assert truth(simulation)["max_plant_force_n"] == 0.0


@pytest.mark.parametrize("robot", [DESCRIPTION, ROBI], ids=lambda robot: robot.name)
def test_whatever_must_not_touch_can_touch(robot):
    world = replace(small_world(), walkers=(WalkerOptions(id="anna", path=((3.0, 3.0),)),))
    model = compose(world, robot, dispensers=1)
    parts = PartTable.of(model, world, robot)
    of, to = model.geom_contype, model.geom_conaffinity
    meets = (of[:, None] & to[None, :]) != 0
    forbidden = parts.matrix[parts.kinds[:, None], parts.kinds[None, :]]
    names = np.array(parts.names)
    never = np.argwhere(forbidden & ~(meets | meets.T))
    assert {tuple(names[pair]) for pair in never} == set()


def found_touching(simulation):
    """Pairs that the referee counts as collisions where everything is now."""
    physics = simulation._physics
    physics.rearranged()
    mujoco.mj_forward(physics.model, physics.data)
    simulation.referee.watch()
    return {frozenset((c.a, c.b)) for c in simulation.referee.collisions}


@pytest.mark.parametrize("part", ["finger_2", "finger_2_tip", "nail_2"])
def test_fingers_and_nails_in_a_wheel_are_a_collision(simulate, part):
    simulation = simulate()
    model, data = simulation._physics.model, simulation._physics.data
    offset = data.body(part).xipos - data.body("base_link").xpos
    model.body("wheel_front_left").pos[:] = data.body("base_link").xmat.reshape(3, 3).T @ offset
    assert frozenset((part, "wheel_front_left")) in found_touching(simulation)


def test_the_feeder_in_the_ground_or_a_wire_is_a_collision(simulate):
    simulation = simulate()
    physics = simulation._physics
    address = physics.model.joint(BASE_JOINT).qposadr[0]
    base = physics.data.qpos[address : address + 7]
    feeder = physics.data.body("feeder").xpos - physics.data.body("base_link").xpos
    wire = next(c for c in simulation.world.capsules if "wire0" in c.name)
    base[:3] = (wire.p0 + wire.p1) / 2 - feeder - (0.0, 0.0765, 0.024)  # through the lips of a tray
    assert frozenset(("feeder", wire.name)) in found_touching(simulation)
    base[:] = -3.0, -1.3, 0.4, 0.0, 1.0, 0.0, 0.0  # on its back
    assert frozenset(("feeder", "ground")) in found_touching(simulation)


def test_a_walker_in_the_feeder_is_a_collision():
    world = replace(small_world(), walkers=(WalkerOptions(id="anna", path=((3.0, 3.0),)),))
    simulation = Simulation(world, DESCRIPTION, options=SimulationOptions(dispensers=0))
    data = simulation._physics.data
    data.mocap_pos[0] = data.body("feeder").xpos - (0.0, 0.0, 1.1)
    assert frozenset(("feeder", "walker/anna")) in found_touching(simulation)
    simulation.close()


def test_entering_a_fence_counts_once(simulate):
    simulation = simulate()
    fence = simulation.world.site.fences[0].polygon
    beats(simulation, 20)
    assert truth(simulation)["fence_crossings"] == 0
    for _ in range(2):
        move_base(simulation, *np.add(fence.min(axis=0), [-0.45, -0.3]))
        beats(simulation, 20)
    assert truth(simulation)["fence_crossings"] == 1
    move_base(simulation, *simulation.world.site.start)
    beats(simulation, 20)
    move_base(simulation, *np.add(fence.min(axis=0), [-0.45, -0.3]))
    beats(simulation, 20)
    assert truth(simulation)["fence_crossings"] == 2


def test_errors_of_the_estimate_add_up(simulate):
    simulation = simulate()
    beats(simulation, 5)
    T = simulation.referee.true_pose()
    off = T @ pose(rotation_z(np.radians(2.0)), (0.3, 0.0, 0.0))
    zero = np.zeros(3)
    estimate = Odometry(
        stamp=simulation.clock.now(),
        frame_id="map",
        child_frame_id="base_link",
        pose=off,
        linear=zero,
        angular=zero,
        pose_covariance=np.zeros((6, 6)),
        twist_covariance=np.zeros((6, 6)),
    )
    beats(simulation, 50, estimate)
    found = simulation.referee.verdict()["localization"]
    assert found["position_rmse_m"] == pytest.approx(0.3, abs=0.005)
    assert found["max_error_m"] == pytest.approx(0.3, abs=0.005)
    assert found["yaw_rmse_deg"] == pytest.approx(2.0, abs=0.1)
    assert simulation.referee.path[-1].error_m == pytest.approx(0.3, abs=0.005)
    assert simulation.referee.path[-1].x == pytest.approx(T[0, 3], abs=0.005)


def test_no_estimate_no_error(simulate):
    simulation = simulate()
    beats(simulation, 5)
    assert simulation.referee.verdict()["localization"]["position_rmse_m"] is None


def test_drivers_do_not_lead_to_the_referee(simulate):
    simulation = simulate(dispensers=1)
    seen, todo = set(), [simulation.drivers]
    while todo:
        thing = todo.pop()
        if id(thing) in seen or isinstance(thing, type):
            continue
        seen.add(id(thing))
        assert thing is not simulation and thing is not simulation.referee and thing is not simulation.world
        if isinstance(thing, dict):
            todo += list(thing.values())
        elif isinstance(thing, (list, tuple, set)):
            todo += list(thing)
        elif type(thing).__module__.startswith("grape"):
            todo += [getattr(thing, name) for name in vars(thing)]


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("shift", "touch"),
    [((0.5, 0.5), True), ((1.5, 0.0), False), ((0.9, -0.9), True), ((2.0, 2.0), False), ((0.0, 1.01), False)],
)
def test_polygons_touch(shift, touch):
    assert polygons_touch(SQUARE, SQUARE + shift) is touch


def test_a_polygon_inside_another_touches_it():
    assert polygons_touch(SQUARE, 0.5 * SQUARE + 0.2)
    assert contains(SQUARE, np.array([0.5, 0.5])) and not contains(SQUARE, np.array([1.5, 0.5]))


def test_a_segment_passes_through_a_loop_or_not():
    angles = np.linspace(0, 2 * np.pi, 17)[:-1]
    loop = np.column_stack([0.02 * np.cos(angles), 0.07 * np.sin(angles), 0.01 * np.cos(2 * angles)])
    up = np.array([0.0, 0.0, 0.05])
    for x, y, through in [(0.0, 0.0, True), (0.01, 0.03, True), (0.03, 0.0, False), (0.0, 0.08, False)]:
        assert passes_through(loop, np.array([x, y, 0.0]) - up, np.array([x, y, 0.0]) + up) is through
    assert not passes_through(loop, up, 2 * up)
