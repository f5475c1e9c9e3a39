"""What closes rows in a costmap: the row's arithmetic on made-up vineyards, and a real one."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from grape.experiments import g4_costmaps as g4
from grape.experiments.driving_yard import yard
from grape.navigation.grid import LETHAL

FINDINGS = g4.Findings(
    asked=3, through={g4.INFLATION: 2, g4.STRIPS: 0}, found={g4.INFLATION: 3, g4.STRIPS: 3}, closing_m=0.2, parked=4,
    closed=1, strip_cells=100, strip_open=0, stands=5, unseen=1, marks=40, stray=2, gone_scans=9,
)  # fmt: skip


def test_figures_are_shares_over_all_vineyards() -> None:
    other = replace(FINDINGS, closing_m=None, parked=0, closed=0, gone_scans=g4.MOST_SCANS + 1)
    found = {quantity.name: quantity for quantity in g4.quantities([FINDINGS, other])}
    assert found["ways that lead through a row, inflation alone"].value == pytest.approx(4 / 6)
    assert found["ways that lead through a row, strips along the rows"].met
    assert found["ways found, strips along the rows"].met
    assert (
        found["places beside plants that it closes too"].value,
        found["places beside plants that it closes too"].n,
    ) == (0.25, 4)
    assert found["inflation beyond the usual that closes rows, median"].n == 1
    assert not found["vineyards in which it stays"].met


def test_a_strip_with_a_hole_is_no_strip() -> None:
    found = {q.name: q for q in g4.quantities([replace(FINDINGS, strip_open=1)])}
    assert not found["cells of strips that are open in the rolling map"].met


@pytest.mark.parametrize(
    ("path", "through"),
    [
        ([[1.0, -1.0], [1.0, 1.0]], True),
        ([[-0.5, -1.0], [-0.5, 1.0]], False),  # around its end
        ([[1.0, -1.0], [2.0, -0.1]], False),  # along it
    ],
)
def test_a_way_crosses_a_row_between_its_ends_alone(path: list[list[float]], through: bool) -> None:
    place = replace(yard(0), rows=(replace(yard(0).rows[0], line=np.array([[0.0, 0.0], [5.0, 0.0]])),))
    assert g4.crosses(np.array(path), place) == through
    assert not g4.crosses(None, place)


def test_what_stands_is_lethal_and_grows() -> None:
    place = yard(0)
    plain, grown = g4.global_map(place), g4.global_map(place, grown_m=0.2)
    assert (plain.cost_at(place.circles[:, :2]) == LETHAL).all()
    beside = place.circles[0, :2] + [place.circles[0, 2] + 0.15, 0.0]
    assert grown.cost_at(beside) == LETHAL
    assert (plain.cost == LETHAL).sum() < (grown.cost == LETHAL).sum()


def test_a_vineyard_is_looked_at_once_and_its_figures_are_read_again(tmp_path: Path) -> None:
    told: list[str] = []
    proof = g4.EXPERIMENT.run(range(1), tmp_path, lambda fraction, line: told.append(line))
    assert proof.complete and told == ["vineyard of seed 0"] and "<svg" in proof.figures[0].svg
    found = {quantity.name: quantity for quantity in proof.quantities}
    assert found["ways that lead through a row, inflation alone"].value > 0.0
    assert found["ways that lead through a row, strips along the rows"].value == 0.0
    assert (
        found["cells of strips that are open in the rolling map"].met
        and found["scans until what has left is gone, median"].value > 1
    )
    saved = json.loads((tmp_path / "seed0.json").read_text(encoding="utf-8"))
    assert asdict(g4.Findings(**saved)) == saved
    again = g4.EXPERIMENT.run(range(1), tmp_path, lambda fraction, line: told.append(line))
    assert len(told) == 1 and again.quantities == proof.quantities
