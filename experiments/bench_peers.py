"""The peers of the manipulation bench: Pinocchio's broadphase, OMPL on it, mink, Open3D."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from grape.experiments.bench_scene import PADDING_M, BenchScene
from grape.kinematics import ArmModel
from grape.messages import Array
from grape.planning import SphereModel

EDGE_STEP_RAD = 0.03  # between the states that the peer checks along a motion, coarser than ours
BROADPHASES = ("DynamicAABBTree", "SSaP")  # of Pinocchio's managers: its examples' choice, and the quickest here
PLAN_PEER = BROADPHASES[0]


class BroadphaseChecker:
    """The same arm, boxes and vines as exact shapes: Pinocchio with one of coal's broadphase trees.

    Args:
        manager: one of Pinocchio's broadphase managers, such as those in `BROADPHASES`.
    """

    def __init__(self, scene: BenchScene, manager: str) -> None:
        self._model = _arm(scene.robot.body)
        shapes = pin.GeometryModel()
        _add_shapes(shapes, scene)
        self._data = self._model.createData()
        self._shapes, self._shape_data = shapes, pin.GeometryData(shapes)
        for request in self._shape_data.collisionRequests:
            request.security_margin = PADDING_M
        for k in range(len(shapes.collisionPairs)):
            pair = shapes.collisionPairs[k]
            names = [shapes.geometryObjects[i].name for i in (pair.first, pair.second)]
            if not any(name.startswith(("vine", "box")) for name in names):
                self._shape_data.collisionRequests[k].security_margin = 0.0
        self._manager = getattr(pin, f"BroadPhaseManager_{manager}CollisionManager")(
            self._model, shapes, self._shape_data
        )

    def is_valid(self, q: Array) -> bool:
        """Whether nothing is nearer than the padding at joint angles (n,) rad."""
        return not pin.computeCollisions(self._model, self._data, self._manager, q, True)


def _arm(body: SphereModel) -> Any:
    """The chain of the sphere model; every joint turns about its own z axis."""
    model, parent = pin.Model(), 0
    for k, placement in enumerate(body.placements):
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(placement[:3, :3], placement[:3, 3]), f"joint_{k}")
    return model


def _add_shapes(shapes: Any, scene: BenchScene) -> None:
    import coal

    body = scene.robot.body
    arm = [
        (c.link, _add_capsule(shapes, f"arm{k}", c.joint, (np.array(c.p0), np.array(c.p1), c.radius)))
        for k, c in enumerate(body.capsules)
    ]
    for k, capsule in enumerate(scene.capsules):
        vine = _add_capsule(shapes, f"vine{k}", 0, capsule)
        for c, (_, index) in zip(body.capsules, arm, strict=True):
            if c.joint > 0:
                shapes.addCollisionPair(pin.CollisionPair(index, vine))
    for box in body.boxes:
        placement = pin.SE3(np.eye(3), np.array(box.center))
        index = shapes.addGeometryObject(
            pin.GeometryObject(f"box_{box.name}", 0, 0, placement, coal.Box(*(2.0 * np.array(box.half_size))))
        )
        for c, (link, member) in zip(body.capsules, arm, strict=True):
            if link not in box.ignore_links and c.joint > 0:
                shapes.addCollisionPair(pin.CollisionPair(member, index))
    for first, second in body.link_pairs:
        for link_a, a in arm:
            for link_b, b in arm:
                if (link_a, link_b) == (first, second):
                    shapes.addCollisionPair(pin.CollisionPair(a, b))


def _add_capsule(shapes: Any, name: str, joint: int, capsule: tuple[Array, Array, float]) -> int:
    import coal

    p0, p1, radius = capsule
    length = float(np.linalg.norm(p1 - p0))
    axis = (p1 - p0) / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).toRotationMatrix()
    geometry = coal.Capsule(radius, length)
    return int(shapes.addGeometryObject(pin.GeometryObject(name, joint, 0, pin.SE3(R, 0.5 * (p0 + p1)), geometry)))


def rrt_connect(
    start: Array,
    goal: Array,
    limits: tuple[Array, Array],
    is_valid: Callable[[Array], bool],
    range_rad: float,
    seed: int,
    timeout_s: float = 60.0,
) -> bool:
    """Whether OMPL's RRTConnect finds a path in time, with its own check of motions; all angles in rad."""
    from ompl import base, geometric, util

    class Validity(base.StateValidityChecker):
        def isValid(self, state: Any) -> bool:
            return bool(is_valid(np.array([state[i] for i in range(len(start))])))

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(seed)
    space = base.RealVectorStateSpace(len(start))
    bounds = base.RealVectorBounds(len(start))
    for i in range(len(start)):
        bounds.setLow(i, float(limits[0][i]))
        bounds.setHigh(i, float(limits[1][i]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(Validity(information))
    information.setStateValidityCheckingResolution(EDGE_STEP_RAD / space.getMaximumExtent())
    information.setup()
    problem = base.ProblemDefinition(information)
    ends = [information.allocState(), information.allocState()]
    for state, q in zip(ends, (start, goal), strict=True):
        for i, angle in enumerate(q):
            state[i] = float(angle)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setRange(range_rad)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(timeout_s)
    found = bool(problem.hasExactSolution())
    information.setStateValidityChecker(base.AllValidStateValidityChecker(information))
    return found


def jacobian_step(arm: ArmModel) -> Callable[[Array, Array], Array]:
    """The same by plain least squares, without limits."""
    return lambda q, twist: np.linalg.lstsq(arm.jacobian(q), twist, rcond=None)[0]


def mink_step(
    mjcf: Path, joints: tuple[str, ...], tip: str, period_s: float = 0.01
) -> Callable[[Array, Array], Array] | None:
    """One step of differential inverse kinematics by mink with joint and speed limits; None where it is not installed.

    The function takes joint angles (n,) and a hand velocity (6,) in m/s and rad/s, and gives joint velocities (n,).
    """
    if importlib.util.find_spec("mink") is None or importlib.util.find_spec("daqp") is None:
        return None
    mink = importlib.import_module("mink")
    model = importlib.import_module("mujoco").MjModel.from_xml_path(str(mjcf))
    configuration = mink.Configuration(model)
    addresses = [int(model.joint(name).qposadr[0]) for name in joints]
    speeds = [int(model.joint(name).dofadr[0]) for name in joints]
    task = mink.FrameTask(tip, "body", position_cost=1.0, orientation_cost=0.2)
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, {name: np.array([0.7]) for name in joints}),
    ]
    q_full = configuration.q.copy()

    def step(q: Array, twist: Array) -> Array:
        q_full[addresses] = q
        configuration.update(q_full)
        now = configuration.get_transform_frame_to_world(tip, "body")
        ahead = mink.SE3.from_rotation_and_translation(
            mink.SO3.exp(twist[3:] * period_s) @ now.rotation(), now.translation() + twist[:3] * period_s
        )
        task.set_target(ahead)
        velocity = mink.solve_ik(configuration, [task], period_s, "daqp", limits=limits)
        return np.asarray(velocity)[speeds]

    return step


def open3d_voxels(points: Array, voxel_m: float) -> Callable[[], int]:
    """Open3D's voxel grid on a cloud that it already holds; returns how many voxels there are."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    return lambda: len(cloud.voxel_down_sample(voxel_m).points)
