"""The time over the number of vines: which rows there are, and what their plans lead through."""

from __future__ import annotations

import pytest

from grape.experiments.bench_navigation import vineyard_size
from grape.sim.worlds import VineyardOptions, generate_vineyard


def test_the_end_of_the_line_is_held_against_the_usual_vineyard() -> None:
    *line, end = vineyard_size.growth("step", "µs", {8: 1.0, 24: 2.0, 640: 2.9}, vineyard_size.GROWTH_GOAL)
    assert [(row.at, row.value, row.peer) for row in line] == [(8, 1.0, ""), (24, 2.0, ""), (640, 2.9, "")]
    assert (end.value, end.peer_value, end.at, end.met) == (2.9, 2.0, None, True)
    assert not vineyard_size.growth("step", "µs", {24: 2.0, 640: 3.1}, vineyard_size.GROWTH_GOAL)[-1].met


def test_the_sizes_reach_from_one_row_to_640_vines() -> None:
    vines = [rows * each for rows, each in vineyard_size.ROWS_AND_VINES]
    assert vines[0] == 8 and {vineyard_size.USUAL, vineyard_size.LARGE} <= set(vines)


@pytest.mark.parametrize(("rows", "vines"), [(1, 8), (3, 8)])
def test_the_plan_leads_past_the_last_row(rows: int, vines: int) -> None:
    world = generate_vineyard(VineyardOptions(rows=rows, vines_per_row=vines, nails_per_row=1, seed=1))
    last = world.site.rows[-1].line
    assert vineyard_size.plan(world) > abs(last[-1] - last[0]).max()
