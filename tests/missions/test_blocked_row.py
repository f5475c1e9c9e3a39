"""A person walks into the lane of the simulated robot and stays: it gives way, tries again and skips the plant."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grape.mission.file import load_mission
from grape.mission.launch import run_mission
from grape.mission.ledger import SqliteLedger
from grape.mission.record import read_events
from grape.navigation.route import park_beside
from grape.sim.worlds import VineyardOptions, vineyard_site
from grape.site import Area, Site, save_site


def strip(id: str, x0: float, x1: float, y0: float, y1: float) -> Area:
    return Area(id=id, polygon=np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))


def dead_end(site: Site, x: float, y: float, yaw: float) -> Site:
    """The site with fences along the lane and across both of its ends, the robot 4.5 m before the stop at x, y."""
    row = site.row("r0").line[:, 0]
    near, far = x - 7.0, row.max() + 1.5
    fences = (
        strip("side", near, far, -2.0, -1.75),
        strip("before the row", near, row.min(), -0.25, 0.0),
        strip("after the row", row.max(), far, -0.25, 0.0),
        strip("near end", near - 0.2, near, -2.0, 0.0),
        strip("far end", far, far + 0.2, -2.0, 0.0),
    )
    return replace(site, fences=fences, start=np.array([x - 4.5, -1.0]), start_heading_rad=yaw)


@pytest.mark.slow
def test_a_lane_that_somebody_blocks_for_good_is_given_up_with_that_reason(tmp_path: Path) -> None:
    os.environ.setdefault("MUJOCO_GL", "egl")
    site = vineyard_site(VineyardOptions(rows=1, vines_per_row=2))
    x, y, yaw = park_beside(site, "r0n0", "fore")
    save_site(dead_end(site, x, y, yaw), tmp_path / "site.geojson")
    place = x - 1.0
    walker = f"{{id: anna, path: [[{place}, -4.0], [{place}, -0.95]], speed: 1.2, start_s: 2.0}}"
    mission = ["world.rows=1", "world.vines_per_row=2", f"world.walkers=[{walker}]", f"site={tmp_path}/site.geojson"]
    mission += [
        "plants=[{plant: r0n0, mode: nail}]",
        "seed=3",
        "time_limit_s=120",
        "actions={CalibrateArm: {skip: true}}",
    ]
    run = run_mission(load_mission("dispenser_deployment", mission), tmp_path / "run")
    events = list(read_events(run.folder / "events.jsonl"))
    ended = [
        (event["name"], event["status"], event["reason"])
        for event in events
        if event["kind"] == "action" and event["status"] != "active"
        if event["name"] in ("DriveToPlant", "BackOff", "Wait", "FinishPlant")
    ]
    assert ended == [
        ("DriveToPlant", "aborted", "blocked"), ("BackOff", "succeeded", ""), ("Wait", "succeeded", ""),
        ("DriveToPlant", "aborted", "blocked"), ("FinishPlant", "succeeded", ""),
    ]  # fmt: skip
    (plant,) = SqliteLedger.open(run.folder / "ledger.sqlite").plants()
    assert (plant.outcome, plant.reason) == ("skipped", "blocked")
    truth = run.result["truth"]
    assert truth["walkers"]["anna"]["contacts"] == 0 and truth["walkers"]["anna"]["least_distance_m"] > 0.1
    assert truth["collisions"] == [] and truth["fence_crossings"] == 0
