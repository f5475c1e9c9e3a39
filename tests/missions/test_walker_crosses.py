"""A person crosses the way of the simulated robot: it stops, waits, goes on, and keeps its distance."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from grape.mission.file import load_mission
from grape.mission.launch import run_mission
from grape.mission.record import read_events

TREE = """<root BTCPP_format="4" main_tree_to_execute="Drive">
  <BehaviorTree ID="Drive">
    <Sequence>
      <WaitForLocalization timeout_s="60"/>
      <DriveToPose x="1.4" y="-1.1" yaw="0.0"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
WALKER = "{id: anna, path: [[0.3, -5.0], [0.3, 5.0]], speed: 1.2}"


@pytest.mark.slow
def test_the_robot_stops_for_a_person_who_crosses_waits_and_goes_on(tmp_path: Path) -> None:
    os.environ.setdefault("MUJOCO_GL", "egl")
    (tmp_path / "drive.xml").write_text(TREE)
    world = ["world.rows=1", "world.vines_per_row=2", f"world.walkers=[{WALKER}]"]
    mission = [*world, "plants=[{plant: r0n0}]", "dispensers=0", "seed=3", "time_limit_s=40", "actions={}"]
    run = run_mission(load_mission("dispenser_deployment", [*mission, f"tree={tmp_path}/drive.xml"]), tmp_path / "run")
    events = list(read_events(run.folder / "events.jsonl"))
    kinds, truth = Counter(event["kind"] for event in events), run.result["truth"]
    drive = next(e for e in events if e["kind"] == "action" and e["name"] == "DriveToPose" and e["status"] != "active")
    assert drive["status"] == "succeeded", drive["detail"]
    assert kinds["waiting"] >= 1 and kinds["recovery"] == 0, "it waited and did not dodge"
    assert truth["walkers"]["anna"]["contacts"] == 0 and truth["collisions"] == []
    assert truth["walkers"]["anna"]["least_distance_m"] >= 0.5
