"""Dispensers that are not in play yet: far below the ground, asleep, until somebody puts them into the feeder.

A sleeping loop costs the physics next to nothing. One that was put somewhere never sleeps again, so that it moves as
those that were there from the start.
"""

from __future__ import annotations

import mujoco
import numpy as np

from grape.messages import Array
from grape.sim.dispenser import place_dispenser

STORE_Z_M = -50.0
STORE_PITCH_M = 0.3  # between neighbours, along map x


def store(spec: mujoco.MjSpec, names: list[str]) -> None:
    """Let dispensers of a specification begin asleep, out of the way; everything else in it never sleeps.

    Also without any the physics may leave out what sleeps: the geoms of the world, of which there are thousands, are
    then not put in place anew in each step.
    """
    spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    for body in spec.worldbody.bodies:
        body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
    for k, name in enumerate(names):
        body = spec.body(name)
        body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_INIT
        body.pos = [STORE_PITCH_M * k, 0.0, STORE_Z_M]


def in_store(z: float) -> bool:
    """Whether what is at this height (m, map frame) is not in play."""
    return z < 0.5 * STORE_Z_M


def take_out(model: mujoco.MjModel, data: mujoco.MjData, name: str, T_map_loop: Array) -> None:
    """Put a dispenser of the store at a pose (4, 4) of its centre, relaxed and at rest."""
    place_dispenser(model, data, name, T_map_loop)
    wake_placed(model, data)


def wake_placed(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let those never sleep again whose state says that they were taken out; MuJoCo wakes them by itself."""
    for tree in np.flatnonzero(model.tree_sleep_policy == mujoco.mjtSleepPolicy.mjSLEEP_INIT):
        joint = model.body_jntadr[model.tree_bodyadr[tree]]
        if not in_store(float(data.qpos[model.jnt_qposadr[joint] + 2])):
            model.tree_sleep_policy[tree] = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
