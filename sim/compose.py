"""One MuJoCo model of a world, a robot in it and the dispensers in its feeder."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import mujoco
import numpy as np

from grape.errors import InvalidInput
from grape.kinematics import read_mjcf
from grape.robots import RobotDescription
from grape.sim.check import refuse_endless
from grape.sim.dispenser import dispenser_elements
from grape.sim.physics import STEP_S
from grape.sim.render import MAX_HEIGHT, MAX_WIDTH
from grape.sim.stock import store
from grape.sim.worlds import Terrain, WalkerOptions, World, is_large, world_spec
from grape.sim.worlds.export import WORLD_CONAFFINITY, WORLD_CONTYPE
from grape.sim.worlds.walkers import BODIES

WORLD_PREFIX = "world/"
BASE_BODY = "base_link"
BASE_JOINT = "base"
DISPENSER = "dispenser_"
WALKER_PREFIX = "walker/"
SEEN_TERRAIN_STEP = 3  # the camera sees every third height of the terrain: a quarter of a frame's time


def compose(
    world: World, robot: RobotDescription, dispensers: int, stock: int = 0, *, seen: bool = False
) -> mujoco.MjModel:
    """The model of a robot with so many dispensers in a world; their poses are set in the state, not here.

    Names of the world's geoms get the prefix `world/`, dispensers are called `dispenser_0`, `dispenser_1`, … The last
    `stock` of them are stored away, asleep, until a refill. Of a large vineyard, what is drawn and never touched is
    left out unless the model is to be `seen`: each geom costs something in each step.
    """
    root = _with_dispensers(robot, dispensers + stock)
    assets = {file: (robot.mjcf.parent / file).read_bytes() for file in _files(root)}
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"), assets=assets)
    store(spec, [f"{DISPENSER}{k}" for k in range(dispensers, dispensers + stock)])
    surroundings = world_spec(world, drawn=seen or not is_large(world))
    spec.visual.map.znear = surroundings.visual.map.znear
    spec.visual.map.zfar = surroundings.visual.map.zfar
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Attaching a child without asset dict")
        spec.attach(surroundings, prefix=WORLD_PREFIX, frame=spec.worldbody.add_frame())
        for walker in world.walkers:
            _add_walker(spec, walker)
        _set_options(spec)
        return spec.compile()


def compose_seen(world: World, robot: RobotDescription, dispensers: int, stock: int = 0) -> mujoco.MjModel:
    """The same model for the camera, its ground drawn with fewer triangles; states of one fit the other."""
    model = compose(
        replace(world, terrain=_coarser(world.terrain, SEEN_TERRAIN_STEP)), robot, dispensers, stock, seen=True
    )
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # a sleeping loop's pose is not updated
    return model


def _add_walker(spec: mujoco.MjSpec, walker: WalkerOptions) -> None:
    """A body that nothing can push; the simulation puts it where its walker is."""
    body = spec.worldbody.add_body(name=WALKER_PREFIX + walker.id, mocap=True)
    for rod in BODIES[walker.kind]:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[rod.radius, 0.0, 0.0],
            fromto=[*rod.p0, *rod.p1],
            rgba=rod.rgba,
            contype=WORLD_CONTYPE,
            conaffinity=WORLD_CONAFFINITY,
        )


def _coarser(terrain: Terrain, step: int) -> Terrain:
    rows, columns = (1 + (n - 1) // step for n in terrain.heights.shape)
    if min(rows, columns) < 2:
        return terrain
    ys, xs = terrain.ys[: (rows - 1) * step + 1 : step], terrain.xs[: (columns - 1) * step + 1 : step]
    return replace(
        terrain,
        heights=terrain.heights[: (rows - 1) * step + 1 : step, : (columns - 1) * step + 1 : step],
        x_range=(float(xs[0]), float(xs[-1])),
        y_range=(float(ys[0]), float(ys[-1])),
    )


def _with_dispensers(robot: RobotDescription, dispensers: int) -> ElementTree.Element:
    """The robot's MJCF with dispensers beside it."""
    refuse_endless(robot.mjcf)
    root = read_mjcf(robot.mjcf)
    worldbody = root.find("worldbody")
    if worldbody is None:
        raise InvalidInput(f"{robot.mjcf} has no <worldbody>")
    equality = ElementTree.SubElement(root, "equality")
    for index in range(dispensers):
        body, connect = dispenser_elements(f"{DISPENSER}{index}", np.eye(4))
        worldbody.append(body)
        equality.append(connect)
    return root


def _files(root: ElementTree.Element) -> set[str]:
    """Meshes and textures that a model names, relative to its file."""
    return {element.attrib["file"] for element in root.iter() if "file" in element.attrib}


def _set_options(spec: mujoco.MjSpec) -> None:
    option = spec.option
    option.timestep = STEP_S
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.impratio = 3.0
    option.iterations = 50
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must be seen, not hidden
    visual = spec.visual
    visual.global_.offwidth = MAX_WIDTH
    visual.global_.offheight = MAX_HEIGHT
    visual.headlight.active = 0
    spec.stat.extent = 1.0
    spec.stat.center = np.zeros(3)
