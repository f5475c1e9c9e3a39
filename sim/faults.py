"""Things that go wrong on purpose, for tests of what the robot then does."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from grape.errors import InvalidInput, with_suggestion
from grape.messages import Array
from grape.sim.compose import BASE_BODY, DISPENSER
from grape.sim.dispenser import place_dispenser
from grape.sim.drivers import SimulatedDrivers
from grape.sim.physics import Physics
from grape.sim.sensors.rgbd import Glare


@dataclass(frozen=True, kw_only=True)
class DropDispenser:
    """Dispenser `index` lies on the ground, half a metre behind the robot."""

    index: int


@dataclass(frozen=True, kw_only=True)
class FreezeSensor:
    """A sensor (a field of `Drivers`, or a scanner's name) stops measuring, or goes on when `frozen` is false."""

    name: str
    frozen: bool = True


@dataclass(frozen=True, kw_only=True)
class GnssJump:
    """GNSS positions are off by `bias` (3,) m for a while, in float mode, or as a fix that is a wrong one."""

    bias: Array
    duration_s: float = 10.0
    wrong_fix: bool = False


@dataclass(frozen=True, kw_only=True)
class CameraGlare:
    """A saturated disc in the camera's pictures from now on; None takes it away."""

    glare: Glare | None


Fault = DropDispenser | FreezeSensor | GnssJump | CameraGlare


def fault_record(fault: Fault) -> dict[str, Any]:
    """A fault as JSON takes it."""
    fields = {name: np.asarray(value).tolist() if name == "bias" else value for name, value in asdict(fault).items()}
    return {"fault": type(fault).__name__, **fields}


def repeat_fault(record: dict[str, Any], physics: Physics, drivers: SimulatedDrivers) -> None:
    """Let a recorded fault begin again in a world that is brought back; what it moved then is in the state."""
    fields = {name: value for name, value in record.items() if name not in ("fault", "step", "planned")}
    match record["fault"]:
        case "FreezeSensor":
            apply_fault(FreezeSensor(**fields), physics, drivers)
        case "GnssJump":
            apply_fault(GnssJump(**fields), physics, drivers)
        case "CameraGlare":
            glare = fields["glare"]
            apply_fault(CameraGlare(glare=Glare(**glare) if glare else None), physics, drivers)


def apply_fault(fault: Fault, physics: Physics, drivers: SimulatedDrivers) -> None:
    """Let a fault begin.

    Raises:
        InvalidInput: there is no such dispenser or sensor.
    """
    match fault:
        case DropDispenser(index=index):
            _drop(physics, index)
        case FreezeSensor(name=name, frozen=frozen):
            if name not in drivers.sensors:
                sentence = f"no sensor {name!r}; allowed: {', '.join(drivers.sensors)}"
                raise InvalidInput(with_suggestion(sentence, name, drivers.sensors))
            drivers.sensors[name].freeze(frozen)
        case GnssJump(bias=bias, duration_s=duration_s, wrong_fix=wrong_fix):
            now = physics.clock.now()
            drivers.gnss.jump(bias, now, now + duration_s, wrong_fix=wrong_fix)
        case CameraGlare(glare=glare):
            drivers.camera.set_glare(glare)


def _drop(physics: Physics, index: int) -> None:
    physics.identify("body", f"{DISPENSER}{index}")
    base = physics.data.body(BASE_BODY)
    T_map_loop = np.eye(4)
    T_map_loop[:3, 3] = base.xpos + base.xmat.reshape(3, 3) @ np.array([-1.0, 0.0, 0.05])
    place_dispenser(physics.model, physics.data, f"{DISPENSER}{index}", T_map_loop)
    physics.rearranged()
