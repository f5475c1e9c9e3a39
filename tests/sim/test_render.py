"""Several renderers in one process: each draws what it would draw alone, whatever becomes of the others."""

import numpy as np
import pytest

from grape.sim.render import Renderer, View

NEAR, FAR = (View(target=np.array([0.0, 0.0, 0.5]), distance_m=distance) for distance in (3.0, 9.0))


@pytest.mark.parametrize("end", ["closed", "dropped"])
def test_the_end_of_a_renderer_leaves_the_others_alone(simulate, end):
    physics = simulate()._physics
    pretty = Renderer(physics.model, 320, 240, pretty=True)
    pretty.color(physics.data, NEAR)
    sensor = Renderer(physics.model, 160, 120)
    color, depth = sensor.color_and_depth(physics.data, NEAR)
    sensor.color_and_depth(physics.data, FAR)
    if end == "closed":
        pretty.close()
    del pretty
    again, depth_again = sensor.color_and_depth(physics.data, NEAR)
    assert color.std() > 5 and np.isfinite(depth).all()
    assert np.array_equal(color, again) and np.array_equal(depth, depth_again)
    sensor.close()
    sensor.close()  # a second time does nothing
