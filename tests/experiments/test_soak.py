"""S1: where the long drive leads, what counts as a stop and its reason, and that a session goes on."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.bt import load_tree
from grape.experiments import soak
from grape.mission.catalog import nodes
from grape.mission.file import load_mission
from grape.sim.worlds import VineyardOptions, vineyard_site


@pytest.fixture(scope="module")
def site() -> Any:
    return vineyard_site(VineyardOptions(seed=1, **soak.WORLD))


def test_the_vineyard_has_two_hectares(site: Any) -> None:
    corners = np.vstack([row.line for row in site.rows])
    length, width = np.ptp(corners, axis=0)
    assert length * (width + soak.WORLD["row_spacing"]) > 20_000


def test_every_row_is_driven_along_with_the_row_on_the_left(site: Any) -> None:
    starts = np.vstack([soak.goals(site)[-1], soak.goals(site)[:-1]])
    for row, before, goal in zip(site.rows, starts, soak.goals(site), strict=True):
        ahead = np.array([np.cos(goal[2]), np.sin(goal[2])])
        along = (row.line - goal[:2]) @ ahead
        assert along.max() == pytest.approx(-soak.PAST_ROWS_M, abs=0.1), "past the end"
        across = (row.line - goal[:2]) @ np.array([-ahead[1], ahead[0]])
        assert 0.6 < across.min() <= across.max() < 1.2
        assert (goal[:2] - before[:2]) @ ahead > 100.0


def test_the_mission_can_be_loaded(tmp_path: Path, site: Any) -> None:
    (tmp_path / "tree.xml").write_text(soak.tour(site))
    (tmp_path / "mission.yaml").write_text(soak.mission_text(seed=3))
    mission = load_mission(str(tmp_path / "mission.yaml"))
    assert (mission.seed, mission.file.dispensers, mission.file.time_limit_s) == (3, 0, 7200.0)
    load_tree(mission.tree, nodes("dispenser"))


def path(*pieces: tuple[float, float]) -> np.ndarray:
    """Five poses a second, for so many seconds at so many m/s."""
    steps = np.concatenate([np.full(round(5 * seconds), 0.2 * speed) for seconds, speed in pieces])
    rows = np.zeros((len(steps), 4))
    rows[:, 0], rows[:, 1] = 0.2 * np.arange(len(steps)), np.cumsum(steps)
    return rows


def test_a_stop_counts_within_a_drive_alone_and_wants_a_reason() -> None:
    driven = path((10.0, 0.8), (5.0, 0.0), (10.0, 0.8), (6.0, 0.0), (10.0, 0.8), (2.0, 0.0), (5.0, 0.8), (30.0, 0.0))
    found = soak.stops(driven, [(0.0, True), (49.0, False)], [(27.0, "no integer fix")])
    assert [(round(stop.start_s), round(stop.end_s), stop.reason) for stop in found] == [
        (10, 14, ""), (25, 30, "no integer fix"),
    ]  # fmt: skip


def test_an_error_counts_as_drift_only_where_the_fix_has_settled() -> None:
    times = np.arange(0.0, 40.0, 0.5)
    settled = soak.settled(times, np.array([12.0, 13.0]))
    assert (times[~settled] == np.arange(12.0, 23.0, 0.5)).all() and soak.settled(times, np.zeros(0)).all()
    error = np.where(settled, 0.02, 0.3)
    assert soak.quarters(error, settled) == ((pytest.approx(0.02), 20), (pytest.approx(0.02), 20))
    assert soak.quarters(error, times > 10.0)[0] == (None, 0)


def test_turning_on_the_spot_is_no_stop() -> None:
    turned = path((10.0, 0.0))
    turned[:, 3] = 0.3 * turned[:, 0]
    assert soak.stops(turned, [(0.0, True)], []) == []


def test_the_growth_of_memory_is_that_of_its_sessions_after_they_are_warm() -> None:
    times = np.arange(0.0, 3600.0, 20.0)
    first = np.column_stack([np.ones_like(times), times, 500.0 + times / 360.0 + 400.0 * (times < 100.0)])
    second = np.column_stack([np.full_like(times, 2.0), times + 3600.0, 300.0 + times / 360.0])
    assert soak.memory_growth(np.vstack([first, second])) == pytest.approx(10.0)
    assert soak.memory_growth(first[:20]) is None
    assert soak.resident_mb() > 10.0


def test_memory_is_noted_now_and_then_and_by_session(tmp_path: Path) -> None:
    file = tmp_path / "memory.csv"
    for start in (0.0, 100.0):
        watch = soak.MemoryWatch(file)
        for k in range(100):
            watch.see(start + 0.5 * k)
    rows = soak.memory_of(file)
    assert rows[:, 0].tolist() == [1, 1, 1, 2, 2, 2]
    assert rows[:3, 1].tolist() == [0.0, 20.0, 40.0]


def test_a_drive_that_was_stopped_goes_on_and_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[str] = []

    def write(folder: Path, minutes: float, ended_by: str) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "mission.yaml").touch()
        result = {
            "seed": 3, "ended_by": ended_by, "sim_time_s": 60.0 * minutes, "sessions": 1, "real_time_factor": 1.5,
            "navigation": {"distance_m": 99.0}, "truth": {"collisions": [], "fence_crossings": 0},
        }  # fmt: skip
        (folder / "result.json").write_text(json.dumps(result))
        driven = path((60.0 * minutes, 0.8))
        rows = np.hstack([driven, driven[:, 1:] + [0.03, 0.04, 0.0]])
        np.savetxt(folder / "path.csv", rows, delimiter=",", header="t_s", comments="")
        event = {
            "t": 1.0,
            "kind": "action",
            "name": "DriveToPose",
            "reason": "",
            "detail": "",
            "start": 0.0,
            "end": 1.0,
        }
        statuses = ("active", "aborted", "active", "succeeded", "active", "preempted")
        (folder / "events.jsonl").write_text("".join(json.dumps({**event, "status": s}) + "\n" for s in statuses))

    def start(mission: Any, folder: Path, **options: Any) -> None:
        begun.append("run")
        options["on_progress"](SimpleNamespace(sim_time_s=30.0, real_time_factor=1.5))
        write(folder, 1.0, "aborted")

    def go_on(folder: Path, **options: Any) -> None:
        begun.append("resume")
        write(folder, 120.0, "time_limit")

    monkeypatch.setattr(soak, "run_mission", start)
    monkeypatch.setattr(soak, "resume_mission", go_on)
    first = soak.run([3], tmp_path, lambda share, text: None)
    second = soak.run([3], tmp_path, lambda share, text: None)
    assert begun == ["run", "resume"] and (first.complete, second.complete) == (False, True)
    values = {q.name: q for q in second.quantities}
    assert values["seed 3: driven for"].met and not {q.name: q for q in first.quantities}["seed 3: driven for"].met
    assert values["seed 3: position error, largest"].value == pytest.approx(0.05)
    arrived = values["seed 3: drives that arrived"]
    assert (arrived.value, arrived.n, arrived.met) == (1.0, 2, False), "one was stopped by us"
