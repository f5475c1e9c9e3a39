"""What a line of `events.jsonl` and of `drive.jsonl` has, by its kind, as far as anything reads it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from pydantic import FiniteFloat, model_validator

from grape.config import Model

Place = tuple[FiniteFloat, FiniteFloat]
Pose = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Cell = tuple[int, int]


class Line(Model, extra="allow"):
    """Any line; further keys are for people."""

    t: FiniteFloat
    kind: str


class _OfPlant(Line):
    plant: str


class _Picture(Line):
    name: str
    file: str


class _Action(Line):
    name: str
    status: str
    reason: str = ""
    detail: str = ""
    start: FiniteFloat
    end: FiniteFloat | None

    @model_validator(mode="after")
    def _tells_its_end(self) -> _Action:
        if self.end is None and self.status != "active":
            raise ValueError(f"end: got None of an action that is {self.status}")
        if self.status in ("aborted", "rejected") and not {"reason", "detail"} <= self.model_fields_set:
            raise ValueError(f"reason and detail: both are needed of an action that is {self.status}")
        return self


class _Crash(Line):
    name: str
    error: str


class _ServoSample(Line):
    action: str = ""
    error_px: FiniteFloat | None = None
    ids: tuple[int, ...] = ()
    corners: tuple[Place, ...] = ()
    desired: tuple[Place, ...] = ()

    @model_validator(mode="after")
    def _as_many_of_each(self) -> _ServoSample:
        if len(self.corners) % max(1, len(self.ids)):
            raise ValueError(f"corners: {len(self.corners)} of {len(self.ids)} ids")
        return self


class _Servo(Line):
    action: str = ""
    converged: bool | None = None
    reason: str = ""
    error_px: FiniteFloat | None = None
    iterations: int | None = None


class CheckLine(Line):
    """What the robot said when it looked."""

    check: str
    value: bool
    level: int | None = None


EVENTS: Mapping[str, type[Line]] = MappingProxyType(
    {
        "plant_started": _OfPlant,
        "plant_finished": _OfPlant,
        "picture": _Picture,
        "action": _Action,
        "crash": _Crash,
        "servo_sample": _ServoSample,
        "servo": _Servo,
    }
)


class _Robot(Line):
    footprint: tuple[Place, ...]
    cell_m: FiniteFloat


class _Estimate(Line):
    source: str
    pose: Pose


class _Gnss(Line):
    place: Place
    status: str


class _Plan(Line):
    points: tuple[Place, ...]


class _Obstacles(Line):
    added: tuple[Cell, ...]
    gone: tuple[Cell, ...]


class _Scan(Line):
    pose: Pose
    points_cm: str


DRIVES: Mapping[str, type[Line]] = MappingProxyType(
    {
        "robot": _Robot,
        "estimate": _Estimate,
        "gnss": _Gnss,
        "plan": _Plan,
        "obstacles": _Obstacles,
        "scan": _Scan,
    }
)
