"""What a mission shows while it runs."""

from __future__ import annotations

import pytest

from grape.mission.display import plain_line
from grape.mission.progress import Progress


@pytest.mark.parametrize(("done", "percent"), [(0, "0 %"), (3, "75 %"), (4, "100 %")])
def test_plain_line_counts_the_plants_that_have_an_outcome(done, percent):
    line = plain_line(Progress(phase="Retract", plant="r1v1", done=done, plants=4, sim_time_s=50.0, wall_time_s=100.0))
    assert line.split() == [
        *percent.split(),
        f"{done}/4",
        "plants",
        "done,",
        "r1v1",
        "Retract",
        "sim",
        "50.0",
        "s",
        "x0.50",
    ]
