"""Run a mission from Python: python examples/run_a_mission.py

Loads the built-in mission with two changes, runs it in simulation and prints what became of each plant.
"""

from __future__ import annotations

import os

from grape.mission.file import load_mission
from grape.mission.launch import run_mission
from grape.mission.progress import Progress


def show(progress: Progress) -> None:
    """One line a few times a second."""
    print(f"\r{progress.percent:3.0f} %  {progress.plant} {progress.phase:<24} {progress.sim_time_s:6.1f} s", end="")


def main() -> None:
    """One nail in a vineyard with seed 3."""
    os.environ.setdefault("MUJOCO_GL", "egl")  # cameras without a screen
    mission = load_mission("dispenser_deployment", ["seed=3", "plants=[{plant: r0n0, mode: nail}]"])
    run = run_mission(mission, on_progress=show)
    print(f"\n{run.result['status']}, see {run.folder}/report.html")
    for plant in run.result["plants"]:
        hangs = run.result["truth"]["plants"][plant["id"]]["hanging"]
        print(f"{plant['id']}: {plant['outcome']} {plant['reason']}, hangs by the referee: {hangs}")


if __name__ == "__main__":
    main()
