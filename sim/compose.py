"""One MuJoCo model of a world, a robot in it and the dispensers in its feeder."""

from __future__ import annotations

import mujoco
import numpy as np

from grape.messages import Array
from grape.robots import RobotDescription
from grape.sim.dispenser import add_dispenser
from grape.sim.physics import STEP_S
from grape.sim.render import MAX_HEIGHT, MAX_WIDTH
from grape.sim.worlds import World, world_spec

WORLD_PREFIX = "world/"
BASE_BODY = "base_link"
BASE_JOINT = "base"
DISPENSER = "dispenser_"


def compose(world: World, robot: RobotDescription, dispensers: int) -> mujoco.MjModel:
    """The model of a robot with so many dispensers in a world; their poses are set in the state, not here.

    Names of the world's geoms get the prefix `world/`, dispensers are called `dispenser_0`, `dispenser_1`, …
    """
    assets = robot.assets()
    spec = mujoco.MjSpec.from_string(robot.mjcf.read_text(encoding="utf-8"), assets=assets)
    for index in range(dispensers):
        add_dispenser(spec, f"{DISPENSER}{index}")
    spec.attach(world_spec(world), prefix=WORLD_PREFIX, frame=spec.worldbody.add_frame())
    _set_options(spec)
    return spec.compile()


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
    getattr(visual, "global").offwidth = MAX_WIDTH
    getattr(visual, "global").offheight = MAX_HEIGHT
    visual.map.znear = 0.02
    visual.map.zfar = 60.0
    visual.headlight.active = 0
    spec.stat.extent = 1.0
    spec.stat.center = np.zeros(3)
