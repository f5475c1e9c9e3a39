"""Row B1: which spurs count, and that an experiment goes on from what it has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grape.experiments import base_placement as b1
from grape.sim.worlds import VineyardOptions, generate_vineyard
from grape.tasks.dispenser.stops import Stop


@pytest.mark.parametrize("style", b1.STYLES)
def test_usable_spurs_are_upright_and_of_the_vine(style: Any) -> None:
    world = generate_vineyard(VineyardOptions(seed=3, style=style, rows=1))
    spurs = b1.usable_spurs(world, "r0v2")
    assert 1 <= len(spurs) <= 8 and {spur.plant for spur in spurs} == {"r0v2"}
    assert all(np.degrees(np.arccos(spur.direction[2])) <= 50.0 for spur in spurs)


def test_more_spurs_are_reached_from_the_chosen_stop(robot_models: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(b1, "first_stop", lambda robot, kind: Stop(ahead_m=0.0, beside_m=0.50))
    found = json.loads(json.dumps(b1.reached(robot_models, 3, "cordon")))
    assert found["usable"] >= found[b1.WAYS[0]] >= max(found[way] for way in b1.WAYS[1:])


def test_vines_that_the_folder_has_are_not_looked_at_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[int, str]] = []
    table = dict(zip(b1.WAYS, (4, 2, 3), strict=True))

    def reached(robot: Any, seed: int, style: str) -> dict[str, int]:
        calls.append((seed, style))
        return {"usable": 4, **table}

    monkeypatch.setattr(b1, "reached", reached)
    b1.run([500], tmp_path, lambda share, text: None)
    proof = b1.run([500, 501], tmp_path, lambda share, text: None)
    assert len(calls) == 4
    values = {q.name: (q.value, q.n) for q in proof.quantities}
    assert values["cordon, chosen stop: usable spurs reached"] == (1.0, 8)
    assert values["gobelet, vine 0.22 m before the arm: vines of which 3 or all usable spurs are reached"] == (0.0, 2)
