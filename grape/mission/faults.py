"""The key `faults` of a mission file: what goes wrong on purpose, and when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

from pydantic import Field

from grape.config import Document, Model
from grape.errors import Problem, did_you_mean

SENSORS = ("base", "arm", "gripper", "camera", "imu", "gnss")
KINDS = "either silent or gnss_jump"
Metres = Annotated[float, Field(ge=-100, le=100)]


class MissionFault(Model):
    """A fault of the simulated robot, from `at_s` on for `for_s` seconds of simulated time.

    `silent`: a sensor that tells nothing meanwhile. `gnss_jump`: m east and north by which GNSS is off meanwhile, and
    does not know it.
    """

    at_s: Annotated[float, Field(ge=0, le=86400)]
    for_s: Annotated[float, Field(gt=0, le=86400)]
    silent: str | None = None
    gnss_jump: tuple[Metres, Metres] | None = None


def check_faults(faults: Sequence[MissionFault], robot: Any, document: Document) -> Iterator[Problem]:
    """What cannot happen to a robot (`grape.robots.RobotDescription`)."""
    known = (*SENSORS, *(name for name, mount in robot.mounts.items() if mount.model))
    for k, fault in enumerate(faults):
        if (fault.silent is None) == (fault.gnss_jump is None):
            yield document.problem(("faults", k), "got both or neither", KINDS)
        elif fault.silent is not None and fault.silent not in known:
            hint = did_you_mean(fault.silent, known)
            yield document.problem(("faults", k, "silent"), f"got {fault.silent!r}", ", ".join(known), hint)
        elif fault.silent is not None and any(_overlap(fault, other) for other in faults[:k]):
            got = f"{fault.silent} is silent already"
            yield document.problem(("faults", k, "at_s"), got, "a time after that, or one longer fault")


def _overlap(one: MissionFault, other: MissionFault) -> bool:
    """Whether two faults silence one sensor at the same time: the end of the first would end the second as well."""
    together = one.at_s < other.at_s + other.for_s and other.at_s < one.at_s + one.for_s
    return one.silent == other.silent and together
