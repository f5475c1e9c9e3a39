"""The configuration of a filter as a user writes it (YAML): sensors, noise, datum, one filter or a cascade."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from grape.config import Model, load_config
from grape.errors import FileError, InvalidInput, Problem
from grape.geodesy import Datum
from grape.geometry import pose, rotation_from_rpy
from grape.localization.beginning import FusionOptions
from grape.localization.cascade import Cascade
from grape.localization.ekf import EkfOptions
from grape.localization.fusion import Fusion
from grape.localization.sensor_options import FLOAT_FACTOR, SensorOptions, per_component
from grape.localization.state import GRAVITY, STATE, Mount, components
from grape.messages import Array

Component = Literal["x", "y", "z", "roll", "pitch", "yaw", "vx", "vy", "vz", "wx", "wy", "wz", "ax", "ay", "az"]
Rate = Literal["wx", "wy", "wz", "ax", "ay", "az"]
Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Place(Model):
    """A pose: metres, and roll, pitch, yaw in radians."""

    xyz: Vector = (0.0, 0.0, 0.0)
    rpy: Vector = (0.0, 0.0, 0.0)

    def matrix(self) -> Array:
        """(4, 4)."""
        return pose(rotation_from_rpy(*self.rpy), self.xyz)


class SensorFile(Model):
    """One sensor; the keys are those of `SensorOptions`."""

    components: tuple[Component, ...] = Field(min_length=1)
    mount: Place = Place()
    frame: Place = Place()
    gravity: NotNegative = GRAVITY
    std: dict[Component, Positive] = Field(default={})
    least_std: dict[Component, Positive] = Field(default={})
    std_per_speed: dict[Component, NotNegative] = Field(default={})
    std_per_turn: dict[Component, NotNegative] = Field(default={})
    status_factors: dict[Literal["single", "float", "fix"], Positive] = Field(
        default={"single": FLOAT_FACTOR, "float": FLOAT_FACTOR}
    )
    differential: bool = False
    relative: bool = False
    yaw_offset: float = 0.0
    pose_gate: Positive | None = None
    twist_gate: Positive | None = None
    acceleration_gate: Positive | None = None
    delay_s: NotNegative = 0.0
    still_below: NotNegative = 0.0
    still_std: Positive = 0.002
    still_bias: tuple[Rate, ...] = ()
    still_bias_s: Positive = 300.0
    relocate_after: Annotated[int, Field(ge=0)] = 0
    effective_track: Positive | None = None

    def options(self) -> SensorOptions:
        """What `Fusion` takes."""
        return SensorOptions(
            components=components(*self.components),
            mount=Mount(T_base_sensor=self.mount.matrix(), T_world_frame=self.frame.matrix(), gravity=self.gravity),
            std=per_component(**self.std),
            least_std=per_component(**self.least_std),
            std_per_speed=per_component(**self.std_per_speed),
            std_per_turn=per_component(**self.std_per_turn),
            status_factors={str(name): factor for name, factor in self.status_factors.items()},
            differential=self.differential,
            relative=self.relative,
            yaw_offset=self.yaw_offset,
            pose_gate=self.pose_gate or inf,
            twist_gate=self.twist_gate or inf,
            acceleration_gate=self.acceleration_gate or inf,
            delay_s=self.delay_s,
            still_below=self.still_below,
            still_std=self.still_std,
            still_bias=components(*self.still_bias),
            still_bias_s=self.still_bias_s,
            relocate_after=self.relocate_after,
        )


class DatumFile(Model):
    """WGS84 origin of map, degrees and metres over the ellipsoid."""

    latitude: Annotated[float, Field(ge=-90, le=90)]
    longitude: Annotated[float, Field(ge=-180, le=180)]
    altitude: float = 0.0

    def value(self) -> Datum:
        """What `Fusion` takes."""
        return Datum(latitude_deg=self.latitude, longitude_deg=self.longitude, altitude_m=self.altitude)


class CascadeFile(Model):
    """Which sensors the local filter has; the global one has all, or with `chain_every_s` all others and "local"."""

    local: tuple[str, ...] = Field(min_length=1)
    chain_every_s: Positive | None = None


class FilterFile(Model):
    """A filter's configuration file."""

    sensors: dict[str, SensorFile] = Field(min_length=1)
    ignore: tuple[str, ...] = ()
    datum: DatumFile | None = None
    frame: Literal["map", "odom"] = "map"
    two_d: bool = False
    rate: Annotated[float, Field(gt=0, le=1000)] = 30.0
    history_s: NotNegative = 1.0
    noise: dict[Component, NotNegative] = Field(default={})
    motion_noise: dict[Component, NotNegative] = Field(default={})
    turn_noise: dict[Component, NotNegative] = Field(default={})
    initial: dict[Component, float] = Field(default={})
    initial_std: dict[Component, Positive] = Field(default={})
    leap_s: Positive = 10.0
    cascade: CascadeFile | None = None


@dataclass(frozen=True, kw_only=True)
class ConfiguredFilter:
    """A filter, or two, as a configuration describes it."""

    file: FilterFile
    fusion: Fusion  # of the estimate: the only one, or the global one
    cascade: Cascade | None

    @property
    def tracks(self) -> dict[str, float | None]:
        """The sensors that a log may hold, with their effective track (m)."""
        return {name: sensor.effective_track for name, sensor in self.file.sensors.items() if name != "local"}


def load_filter(path: Path, overrides: Iterable[str] = ()) -> ConfiguredFilter:
    """Read a configuration and build its filter.

    Raises:
        FileError: with every problem of the file.
    """
    file = load_config(FilterFile, path, overrides)
    try:
        return build_filter(file)
    except InvalidInput as error:
        raise FileError([Problem(file=str(path), got=str(error))]) from error


def build_filter(file: FilterFile) -> ConfiguredFilter:
    """The filter of a checked configuration.

    Raises:
        InvalidInput: options that exclude each other, or a cascade of unknown sensors.
    """
    sensors = {name: _checked(name, sensor) for name, sensor in file.sensors.items()}
    datum = None if file.datum is None else file.datum.value()
    if file.cascade is None:
        fusion = Fusion(sensors, _fusion_options(file, file.frame), datum=datum)
        return ConfiguredFilter(file=file, fusion=fusion, cascade=None)
    local, chain = file.cascade.local, file.cascade.chain_every_s
    if unknown := [name for name in local if name not in sensors]:
        raise InvalidInput(f"cascade.local: unknown sensors {unknown}; known: {', '.join(sensors)}")
    if (chain is not None) != ("local" in sensors):
        raise InvalidInput("cascade.chain_every_s and a sensor named `local`, the local estimate, belong together")
    below = {name: options for name, options in sensors.items() if name in local}
    above = {name: options for name, options in sensors.items() if chain is None or name not in local}
    cascade = Cascade(
        Fusion(below, _fusion_options(file, "odom"), datum=datum),
        Fusion(above, _fusion_options(file, "map"), datum=datum),
        chain_every_s=chain or inf,
    )
    return ConfiguredFilter(file=file, fusion=cascade.global_, cascade=cascade)


def _checked(name: str, sensor: SensorFile) -> SensorOptions:
    try:
        return sensor.options()
    except InvalidInput as error:
        raise InvalidInput(f"sensors.{name}: {error}") from error


def _fusion_options(file: FilterFile, frame: str) -> FusionOptions:
    standard = EkfOptions()
    ekf = EkfOptions(
        noise=_changed(standard.noise, file.noise),
        motion_noise=_changed(standard.motion_noise, file.motion_noise),
        turn_noise=_changed(standard.turn_noise, file.turn_noise),
        two_d=file.two_d,
        history_s=file.history_s,
    )
    own = frame == file.frame or file.cascade is None
    return FusionOptions(
        filter=ekf,
        frame_id=frame,
        initial={str(name): value for name, value in file.initial.items() if own},
        initial_std={str(name): value for name, value in file.initial_std.items() if own},
        leap_s=file.leap_s,
    )


def _changed(values: Array, by_name: dict[Component, float]) -> Array:
    return np.array([by_name.get(name, value) for name, value in zip(STATE, values, strict=True)])  # type: ignore[call-overload]
