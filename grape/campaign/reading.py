"""What a finished run folder says, as far as a campaign needs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from grape.campaign.plan import Job
from grape.config import load_yaml
from grape.mission.record import read_events
from grape.mission.record_lines import EVENTS, CheckLine

# What reports call some keys of the mission file.
CONDITIONS: Mapping[str, str] = MappingProxyType(
    {"style": "world.style", "light": "world.sun", "arm_errors": "arm_errors"}
)
QUESTIONS = frozenset({"HoldsDispenser", "NextPlant"})  # actions whose failure is an answer
FAILED = ("aborted", "rejected")


@dataclass(frozen=True, kw_only=True)
class ActionFailure:
    """An action that failed, and its own picture or the nearest one (a path in the run folder, or empty)."""

    action: str
    reason: str
    detail: str
    time_s: float
    picture: str = ""


@dataclass(frozen=True, kw_only=True)
class Check:
    """What the robot said when it looked, and what was so; `level_right` where it also named the topmost level."""

    name: str
    said: bool
    true: bool
    level_right: bool | None = None


@dataclass(frozen=True, kw_only=True)
class PlantRun:
    """One plant of one mission.

    Attributes:
        conditions: of its mission: the `CONDITIONS`, and whatever else was varied.
        hanging: by the referee.
        failures: of its actions, oldest first.
        end_s: when the robot was done with it.
        last_picture: the newest before that.
    """

    seed: int
    plant: str
    mode: str
    outcome: str
    reason: str
    hanging: bool
    cycle_s: float | None
    phases_s: Mapping[str, float]
    conditions: Mapping[str, Any]
    failures: Sequence[ActionFailure] = ()
    end_s: float = 0.0
    last_picture: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the robot's account of it agrees with the referee."""
        return (self.outcome == "deployed") == self.hanging


@dataclass(frozen=True, kw_only=True)
class RunData:
    """One finished mission. Attributes: checks: those whose truth the referee noted."""

    job: Job
    result: Mapping[str, Any]
    conditions: Mapping[str, Any]
    plants: Sequence[PlantRun]
    checks: Sequence[Check]


@dataclass(kw_only=True)
class _PlantEvents:
    failures: list[dict[str, Any]] = field(default_factory=list)
    pictures: list[dict[str, Any]] = field(default_factory=list)
    end_s: float = 0.0
    finished: bool = False


def read_run(job: Job, result: Mapping[str, Any]) -> RunData:
    """A finished mission from its folder."""
    events = list(read_events(job.folder / "events.jsonl", {**EVENTS, "check": CheckLine}))
    conditions = _conditions(job)
    by_plant = _by_plant(events)
    all_pictures = [event for event in events if event["kind"] == "picture"]
    truth = result["truth"] or {}
    plants = []
    for plant in result["plants"]:
        own = by_plant.get(plant["id"], _PlantEvents())
        pictures = own.pictures or all_pictures
        plants.append(
            PlantRun(
                seed=job.seed,
                plant=plant["id"],
                mode=plant["mode"],
                outcome=plant["outcome"],
                reason=plant["reason"],
                hanging=bool(truth.get("plants", {}).get(plant["id"], {}).get("hanging")),
                cycle_s=plant["cycle_s"],
                phases_s=plant["phases_s"],
                conditions=conditions,
                failures=tuple(_failure(event, pictures) for event in own.failures),
                end_s=own.end_s,
                last_picture=_nearest(pictures, own.end_s),
            )
        )
    said = [event for event in events if event["kind"] == "check"]
    checks = _checks(said, truth.get("checks", ()))
    return RunData(job=job, result=result, conditions=conditions, plants=tuple(plants), checks=checks)


def _conditions(job: Job) -> dict[str, Any]:
    """Values of the mission that ran, under the names of the report."""
    mission = load_yaml(job.folder / "mission.yaml").data
    names = {key: name for name, key in CONDITIONS.items()}
    found = {name: _lookup(mission, key, None) for name, key in CONDITIONS.items()}
    return found | {names.get(key, key): _lookup(mission, key, text) for key, text in job.varied.items()}


def _lookup(data: Any, key: str, default: Any) -> Any:
    for part in key.split("."):
        if not isinstance(data, Mapping) or part not in data:
            return default
        data = data[part]
    return data


def _by_plant(events: Sequence[Mapping[str, Any]]) -> dict[str, _PlantEvents]:
    """Failures and pictures by plant; what happens between two `plant_started` belongs to the first."""
    found: dict[str, _PlantEvents] = {}
    current = _PlantEvents()
    for event in events:
        kind = event["kind"]
        if kind == "plant_started":
            current = found.setdefault(str(event["plant"]), _PlantEvents())
        if kind == "picture":
            current.pictures.append(dict(event))
        elif kind == "crash" or (kind == "action" and event["status"] in FAILED and event["name"] not in QUESTIONS):
            current.failures.append(dict(event))
        if not current.finished:
            current.end_s = float(event["t"])
        current.finished |= kind == "plant_finished"
    return found


def _failure(event: Mapping[str, Any], pictures: Sequence[Mapping[str, Any]]) -> ActionFailure:
    crash = event["kind"] == "crash"
    time_s, name = float(event["t"]), str(event["name"])
    own = [p for p in pictures if p["name"].startswith(name) and event.get("start", 0.0) <= p["t"] <= time_s]
    return ActionFailure(
        action=name,
        reason="crash" if crash else str(event["reason"]),
        detail=str(event["error"] if crash else event["detail"]),
        time_s=time_s,
        picture=_nearest(own or pictures, time_s),
    )


def _nearest(pictures: Sequence[Mapping[str, Any]], time_s: float) -> str:
    """The file of the picture taken nearest to a time."""
    return str(min(pictures, key=lambda picture: abs(picture["t"] - time_s))["file"]) if pictures else ""


def _checks(said: Sequence[Mapping[str, Any]], witnessed: Sequence[Mapping[str, Any]]) -> tuple[Check, ...]:
    """Each look of the robot at which the referee noted what was so, found by name and time."""
    noted = {(truth["check"], round(truth["time_s"], 3)): truth for truth in witnessed if truth["true"] is not None}
    pairs = [(event, noted.get((event["check"], round(event["t"], 3)))) for event in said]
    return tuple(
        Check(
            name=event["check"],
            said=bool(event["value"]),
            true=truth["true"],
            level_right=_level_right(event.get("level"), truth.get("level")),
        )
        for event, truth in pairs
        if truth is not None
    )


def _level_right(said: int | None, true: int | None) -> bool | None:
    return None if said is None or true is None else said == true
