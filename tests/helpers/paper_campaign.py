"""Run folders as missions leave them, made without running any."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from grape.campaign.plan import Job
from grape.mission.file import load_mission
from grape.mission.launch import write_inputs

PLANTS = (("r0v1", "plant"), ("r0n0", "nail"))
OPEN_LOOP = (("r0v1", "plant_open_loop"),)


def write_run(
    job: Job,
    *,
    outcomes: dict[str, str] | None = None,
    hanging: tuple[str, ...] = ("r0v1", "r0n0"),
    failures: tuple[tuple[str, str, str, float], ...] = (),
    checks: tuple[tuple[str, bool, bool], ...] = (("grasp", True, True),),
    levels: tuple[tuple[int, int], ...] = (),
    dropped: int = 0,
    status: str = "succeeded",
) -> None:
    """A finished run of two plants.

    Args:
        outcomes: reason by plant that is skipped.
        failures: plant, action, reason, time.
        checks: name, what the robot said, what was so.
        levels: what the robot said of the feeder's top and what was so, for the first checks.
    """
    outcomes = outcomes or {}
    shutil.rmtree(job.folder, ignore_errors=True)
    job.folder.mkdir(parents=True)
    write_inputs(load_mission("dispenser_deployment", [*job.settings, f"seed={job.seed}"]), job.folder)
    (job.folder / "pictures").mkdir()
    (job.folder / "report.html").touch()
    cv2.imwrite(str(job.folder / "pictures/001_grasp.png"), np.full((48, 64, 3), 90, np.uint8))
    events: list[dict[str, Any]] = []
    plants = OPEN_LOOP if any("plant_open_loop" in setting for setting in job.settings) else PLANTS
    for k, (plant, mode) in enumerate(plants):
        t = 10.0 + 50.0 * k
        events.append({"t": t, "kind": "plant_started", "plant": plant, "mode": mode})
        events.append({"t": t + 5, "kind": "picture", "name": "grasp", "file": "pictures/001_grasp.png"})
        events += [
            {"t": at, "kind": "action", "name": name, "status": "aborted", "reason": reason}
            | {"detail": f"{name} < 3", "start": at - 2.0, "end": at}
            for of, name, reason, at in failures
            if of == plant
        ]
        events.append({"t": t + 40, "kind": "plant_finished", "plant": plant})
    said = [{"level": level[0]} for level in levels] + [{}] * len(checks)
    seen = [{"level": level[1]} for level in levels] + [{}] * len(checks)
    events += [
        {"t": 90.0 + k, "kind": "check", "check": check[0], "value": check[1], **said[k]}
        for k, check in enumerate(checks)
    ]
    (job.folder / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    result = {
        "mission": "dispenser_deployment",
        "seed": job.seed,
        "status": status,
        "ended_by": "tree",
        "detail": "",
        "sim_time_s": 100.0,
        "wall_time_s": 100.0,
        "real_time_factor": 1.0,
        "plants": [_plant(plant, mode, outcomes.get(plant, "")) for plant, mode in plants],
        "dispensers": {"loaded": 8, "deployed": 2, "left": 6, "lost": 0, "on_hand": 0},
        "places": {"feeder": 6, "hand": 0, "lost": 0, **{plant: int(plant not in outcomes) for plant, _ in PLANTS}},
        "truth": {
            "places": {"feeder": 6, "hand": 0, "dropped": dropped, **{plant: 1 for plant in hanging}},
            "hanging": list(hanging),
            "dropped": dropped,
            "collisions": [],
            "fence_crossings": 0,
            "max_plant_force_n": 1.0 + job.seed,
            "plants": {plant: {"hanging": plant in hanging} for plant, _ in PLANTS},
            "checks": [
                {"time_s": 90.0 + k, "check": check[0], "true": check[2], **seen[k]} for k, check in enumerate(checks)
            ],
        },
        "localization": {"position_rmse_m": 0.01, "yaw_rmse_deg": 0.1, "max_error_m": 0.02},
    }
    (job.folder / "result.json").write_text(json.dumps(result))


def _plant(plant: str, mode: str, reason: str) -> dict[str, Any]:
    return {
        "id": plant,
        "mode": mode,
        "outcome": "skipped" if reason else "deployed",
        "reason": reason,
        "attempts": 1,
        "servo": {"error_px": None, "iterations": None, "runs": []},
        "cycle_s": None if reason else 40.0,
        "phases_s": {"DriveToPlant": 10.0, "Retract": 5.0},
    }


class PaperEngine:
    """Ends every job at the next look; `write` says what it leaves behind."""

    def __init__(self, write: Callable[[Job], None]) -> None:
        self.write = write
        self.started: list[int] = []
        self.stopped = False
        self._running: list[Job] = []

    def __call__(self) -> PaperEngine:
        return self

    def start(self, job: Job) -> None:
        self.started.append(job.seed)
        self._running.append(job)

    def ended(self) -> list[Job]:
        done, self._running = self._running, []
        for job in done:
            self.write(job)
        return done

    def stop(self) -> None:
        self.stopped = True
