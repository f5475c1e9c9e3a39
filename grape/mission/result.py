"""`result.json`: what a mission came to, in a form that other programs read (schema `grape.result/1`)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grape.actions.core import Outcome
from grape.mission.file import Mission
from grape.mission.ledger import SqliteLedger
from grape.mission.record import plain, write_atomic
from grape.mission.runner import Finding
from grape.site_features import DROPPED, LOST, STOCK

SCHEMA = "grape.result/1"
STILL_THERE_S = 0.1  # a drive that took no longer: the base had not moved since an interruption
SERVO_KEYS = ("action", "converged", "reason", "error_px", "iterations")
ENDED = ("succeeded", "aborted", "preempted", "rejected")


@dataclass(kw_only=True)
class PlantRecord:
    """What the events of one plant add up to.

    Attributes:
        phases_s: seconds by action name.
        arrived_s, retracted_s: when the base stood, also before an interruption, and when the arm was back.
        servo: one entry for each servo run, converged or not.
    """

    phases_s: dict[str, float] = field(default_factory=dict)
    arrived_s: float | None = None
    retracted_s: float | None = None
    servo: list[dict[str, Any]] = field(default_factory=list)

    @property
    def cycle_s(self) -> float | None:
        """From base stop to arm retracted."""
        if self.arrived_s is None or self.retracted_s is None or self.retracted_s < self.arrived_s:
            return None
        return round(self.retracted_s - self.arrived_s, 3)


def plant_records(events: Iterable[dict[str, Any]]) -> dict[str, PlantRecord]:
    """Phases, cycle and servo runs of each plant; what happens between two `plant_started` belongs to the first."""
    records: dict[str, PlantRecord] = {}
    current: PlantRecord | None = None
    for event in events:
        kind = event["kind"]
        if kind == "plant_started":
            current = records.setdefault(str(event["plant"]), PlantRecord())
        elif current is None:
            continue
        elif kind == "action" and event["status"] in ENDED:
            _add_action(current, event)
        elif kind == "servo":
            current.servo.append({key: event.get(key) for key in SERVO_KEYS})
    return records


def _add_action(record: PlantRecord, event: dict[str, Any]) -> None:
    name, start, end = str(event["name"]), float(event["start"]), float(event["end"])
    record.phases_s[name] = round(record.phases_s.get(name, 0.0) + end - start, 3)
    if event["status"] == "succeeded" and name == "DriveToPlant":
        if record.arrived_s is None or end - start > STILL_THERE_S:
            record.arrived_s = end
    elif event["status"] == "succeeded" and name == "Retract":
        record.retracted_s = end


def status_of(finding: Finding, outcomes: Iterable[Outcome | None]) -> str:
    """succeeded: every plant deployed; partial: some; failed: none, or a crash; aborted: somebody ended it.

    Without plants the tree decides.
    """
    if finding.ended_by == "aborted":
        return "aborted"
    if finding.ended_by == "crash":
        return "failed"
    deployed = [outcome is Outcome.DEPLOYED for outcome in outcomes] or [finding.succeeded]
    return "succeeded" if all(deployed) else "partial" if any(deployed) else "failed"


def build_result(
    mission: Mission,
    finding: Finding,
    ledger: SqliteLedger,
    events: Iterable[dict[str, Any]],
    verdict: dict[str, Any] | None,
) -> dict[str, Any]:
    """The content of result.json; only `wall_time_s` and `real_time_factor` depend on the machine it ran on.

    Args:
        events: of the run, oldest first.
        verdict: the referee's `truth` and `localization`; None on a real robot.
    """
    events = list(events)
    records = plant_records(events)
    tasks = ledger.plants()
    factor = finding.sim_time_s / finding.wall_time_s if finding.wall_time_s > 0 else 0.0
    nothing_known = {"position_rmse_m": None, "yaw_rmse_deg": None, "max_error_m": None}
    localization = (verdict or {}).get("localization") or nothing_known
    recoveries = sum(event["kind"] == "recovery" for event in events)
    return {
        "schema": SCHEMA,
        "mission": mission.name,
        "robot": mission.file.robot,
        "drivers": mission.file.drivers,
        "seed": mission.seed,
        "status": status_of(finding, (task.outcome for task in tasks)),
        "ended_by": finding.ended_by,
        "detail": finding.detail,
        "sim_time_s": round(finding.sim_time_s, 3),
        "wall_time_s": round(finding.wall_time_s, 3),
        "real_time_factor": round(factor, 3),
        "sessions": 1 + sum(event["kind"] == "mission_resumed" for event in events),
        "plants": [_plant(task, records.get(task.plant, PlantRecord())) for task in tasks],
        "dispensers": ledger.account(),
        "places": dict(ledger.dispensers()),
        "truth": plain((verdict or {}).get("truth")),
        "localization": {key: _rounded(value) for key, value in localization.items()},
        "navigation": {"distance_m": round(finding.track.distance_m, 2), "recoveries": recoveries},
    }


def _plant(task: Any, record: PlantRecord) -> dict[str, Any]:
    last: dict[str, Any] = next((run for run in reversed(record.servo) if run["converged"]), {})
    return {
        "id": task.plant,
        "mode": task.mode,
        "outcome": str(task.outcome),
        "reason": task.reason,
        "attempts": task.attempts,
        "cycle_s": record.cycle_s,
        "phases_s": record.phases_s,
        "servo": {"error_px": last.get("error_px"), "iterations": last.get("iterations"), "runs": record.servo},
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), 4)


def true_places(truth: Mapping[str, Any]) -> dict[str, int]:
    """Where the referee has seen dispensers, under the names of the robot's account: what is dropped is lost.

    Those that are not in play yet do not count.
    """
    places = {place: number for place, number in truth["places"].items() if place != STOCK}
    return {LOST if place == DROPPED else place: number for place, number in places.items()}


def misplaced(account: Mapping[str, int], seen: Mapping[str, int]) -> dict[str, int]:
    """Dispensers that the account has at a place where they are not, by place.

    Args:
        account, seen: dispensers by place; what is missing is 0.
    """
    surplus = {place: number - seen.get(place, 0) for place, number in account.items()}
    return {place: number for place, number in surplus.items() if number > 0}


def lost_unnoticed(result: Mapping[str, Any]) -> int:
    """Dispensers on the ground that the robot's account has in the feeder, in the hand or on a plant."""
    truth = result["truth"]
    if not truth:
        return 0
    if "places" not in truth:  # an earlier version told numbers alone
        return max(0, int(truth["dropped"]) - int(result["dispensers"]["lost"]))
    wrong = misplaced(result["places"], true_places(truth))
    return min(int(truth["dropped"]), sum(number for place, number in wrong.items() if place != "lost"))


def write_result(result: dict[str, Any], folder: Path) -> None:
    """Write result.json; it appears whole or not at all."""
    write_atomic(folder / "result.json", json.dumps(result, indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def without_wall_clock(result: dict[str, Any]) -> dict[str, Any]:
    """A result as two runs of one seed must agree on it."""
    return {key: value for key, value in result.items() if key not in ("wall_time_s", "real_time_factor")}
