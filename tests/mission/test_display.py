"""What a mission shows while it runs."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from grape.mission.display import plain_line, summary
from grape.mission.progress import Progress


def test_brackets_in_what_went_wrong_are_shown_as_they_are() -> None:
    result = {
        "mission": "m", "seed": 1, "status": "failed", "plants": [], "wall_time_s": 1.0, "truth": None,
        "dispensers": {"deployed": 0, "left": 8, "lost": 0}, "localization": {"position_rmse_m": None},
        "detail": "could not open port [/dev/ttyACM0], got [nan, nan]",
    }  # fmt: skip
    console = Console(width=120, file=io.StringIO())
    console.print(summary(result))
    assert result["detail"] in console.file.getvalue()


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
