"""The squares of a world: what is in them is never taken for nothing."""

import numpy as np

from grape.sim._culling_kernels import in_cells
from grape.sim.cells import CELL_M, Cells


def test_a_box_is_found_where_it_overlaps_another_and_not_far_beside_above_or_below():
    rng = np.random.default_rng(0)
    low = rng.uniform([-4.0, -3.0, 0.0], [6.0, 5.0, 1.0], (30, 3))
    cells = Cells.of_boxes(np.hstack([low, low + rng.uniform(0.01, 1.5, (30, 3))]))
    standing = np.hstack([low, low])
    assert all(in_cells(box, cells.lowest, cells.highest, cells.origin, CELL_M) for box in standing)
    for shift in ([-20.0, 0, 0], [20.0, 0, 0], [0, -20.0, 0], [0, 20.0, 0], [0, 0, 5.0], [0, 0, -5.0]):
        moved = standing + np.tile(shift, 2)
        assert not any(in_cells(box, cells.lowest, cells.highest, cells.origin, CELL_M) for box in moved), shift
