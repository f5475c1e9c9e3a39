"""What sleeps costs nothing and changes nothing: the world stands where it stood, and the robot moves as it did."""

import mujoco
import numpy as np

SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)


def driven(simulation, beats):
    for _ in range(beats):
        simulation.drivers.base.send(0.6, 0.3)
        simulation.advance()
    return simulation._physics


def test_a_scene_whose_world_sleeps_moves_as_the_waking_one_to_the_last_bit(simulate):
    asleep, awake = simulate(seed=3, dispensers=2), simulate(seed=3, dispensers=2)
    assert asleep._physics.model.opt.enableflags & SLEEP
    awake._physics.model.opt.enableflags &= ~SLEEP
    one, other = driven(asleep, 60), driven(awake, 60)
    for field in ("qpos", "qvel", "geom_xpos", "geom_xmat", "site_xpos"):
        np.testing.assert_array_equal(getattr(one.data, field), getattr(other.data, field), err_msg=field)
    assert (one.model.tree_sleep_policy == mujoco.mjtSleepPolicy.mjSLEEP_NEVER).all()


def test_the_world_is_in_place_from_the_start(simulate):
    physics = simulate()._physics
    placed = mujoco.MjData(physics.model)
    physics.model.opt.enableflags &= ~SLEEP
    mujoco.mj_kinematics(physics.model, placed)
    fixed = physics.model.body_weldid[physics.model.geom_bodyid] == 0
    assert fixed.sum() > 50
    np.testing.assert_array_equal(physics.data.geom_xpos[fixed], placed.geom_xpos[fixed])
