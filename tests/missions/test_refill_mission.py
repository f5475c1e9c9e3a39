"""The real thing with an empty feeder: it is refilled, and an interruption at the worst moment costs nothing."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grape.mission.file import load_mission
from grape.mission.launch import resume_mission, run_mission
from grape.mission.record import read_events
from grape.sim.worlds import VineyardOptions, vineyard_site
from grape.site import save_site


@pytest.fixture
def settings(tmp_path: Path) -> list[str]:
    """A mission on one nail, with an empty feeder, that starts 0.7 m before the refill point."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    site = vineyard_site(VineyardOptions(rows=1, vines_per_row=2))
    (point,) = site.refills
    start = point.position - 0.7 * np.array([np.cos(point.yaw_rad), np.sin(point.yaw_rad)])
    path = tmp_path / "site.geojson"
    save_site(replace(site, start=start, start_heading_rad=point.yaw_rad), path)
    world = ["world.rows=1", "world.vines_per_row=2", "plants=[{plant: r0n0, mode: nail}]", f"site={path}"]
    skip = "actions={CalibrateArm: {skip: true}}"
    return [*world, "seed=3", "dispensers=0", "refill.after_s=[1, 1.5]", skip]


def seen(folder: Path, kind: str, seconds: float, **fields: str) -> Callable[[], bool]:
    """Whether so much simulated time has passed since an event."""
    beats = iter(range(10**9))
    found: list[int] = []

    def asked() -> bool:
        beat = next(beats)
        events = folder / "events.jsonl"
        if not found and beat % 20 == 0 and events.exists():
            for event in read_events(events):
                if event["kind"] == kind and all(event.get(key) == value for key, value in fields.items()):
                    found.append(beat)
                    break
        return bool(found) and beat >= found[0] + round(100 * seconds)

    return asked


def test_a_robot_that_is_cut_off_between_refill_and_confirmation_counts_it_once(
    settings: list[str], tmp_path: Path
) -> None:
    mission = load_mission("dispenser_deployment", [*settings, "time_limit_s=40"])
    folder = tmp_path / "run"
    waiting = seen(folder, "action", 2.5, name="WaitForRefill", status="active")
    first = run_mission(mission, folder, cancelled=waiting).result
    assert first["ended_by"] == "aborted"
    assert first["truth"]["in_feeder"] == 1, "the operator has put it in"
    assert first["dispensers"]["loaded"] == 0, "but not said so"
    again = resume_mission(folder, cancelled=seen(folder, "refilled", 1.0)).result
    assert again["ended_by"] == "aborted" and again["sessions"] == 2
    assert again["dispensers"] == {"loaded": 1, "deployed": 0, "left": 1, "lost": 0, "on_hand": 0}
    assert (again["truth"]["loaded"], again["truth"]["in_feeder"]) == (1, 1)
    names = [event["name"] for event in read_events(folder / "events.jsonl") if event["kind"] == "action"]
    assert "DriveToRefill" in names and "refilled" in [e["kind"] for e in read_events(folder / "events.jsonl")]


@pytest.mark.slow
def test_a_dispenser_from_a_refill_is_hung(settings: list[str], tmp_path: Path) -> None:
    result = run_mission(load_mission("dispenser_deployment", settings), tmp_path / "run").result
    assert result["status"] == "succeeded" and result["truth"]["hanging"] == ["r0n0"]
    assert result["dispensers"] == {"loaded": 1, "deployed": 1, "left": 0, "lost": 0, "on_hand": 0}
    assert result["truth"]["loaded"] == 1 and result["truth"]["collisions"] == []
