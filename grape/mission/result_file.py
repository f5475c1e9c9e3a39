"""Reading a `result.json`, which may be damaged: whole, or refused with every place that is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, FiniteFloat, model_validator

from grape.config import Document, Model, validate
from grape.mission.record import read_json


class _Part(Model, extra="allow"):
    """What is read of a part of the result; later versions add fields."""


class _Servo(_Part):
    error_px: FiniteFloat | None


class _Plant(_Part):
    id: str
    mode: str
    outcome: str
    reason: str
    attempts: int
    cycle_s: FiniteFloat | None
    phases_s: dict[str, FiniteFloat]
    servo: _Servo


class _Account(_Part):
    deployed: int
    left: int
    lost: int


class _Judged(_Part):
    hanging: bool


class _Check(_Part):
    check: str
    time_s: FiniteFloat
    true: bool | None
    level: int | None = None


class _Truth(_Part):
    hanging: list[str]
    dropped: int
    places: dict[str, int] = Field(default_factory=dict)
    plants: dict[str, _Judged]
    checks: tuple[_Check, ...] = ()
    collisions: list[dict[str, Any]]
    fence_crossings: int
    max_plant_force_n: FiniteFloat


class _Localization(_Part):
    position_rmse_m: FiniteFloat | None


class _Result(_Part):
    mission: str
    seed: int
    status: str
    ended_by: str
    detail: str
    sim_time_s: FiniteFloat
    wall_time_s: FiniteFloat
    real_time_factor: FiniteFloat
    plants: list[_Plant]
    dispensers: _Account
    places: dict[str, int] = Field(default_factory=dict)
    truth: _Truth | None
    localization: _Localization

    @model_validator(mode="after")
    def _both_places(self) -> _Result:
        truth = self.truth
        if truth is not None and ("places" in self.model_fields_set) != ("places" in truth.model_fields_set):
            raise ValueError("places: the account and the truth both have them, or neither has")
        return self


def read_result(path: Path) -> dict[str, Any]:
    """The content of a result.json.

    Raises:
        FileError: it cannot be read or is not what `grape` wrote, with every place that is wrong.
    """
    result = read_json(path)
    validate(_Result, Document(file=str(path), data=result))
    return result
