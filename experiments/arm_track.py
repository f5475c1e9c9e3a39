"""A parked robot whose arm is watched at every beat: what its encoders tell, and where its hand really is."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np

from grape.actions.core import Actuator, Feedback
from grape.drivers import ArmDriver
from grape.errors import ActionFailed
from grape.experiments.arm_bench import ArmBench
from grape.geometry import rotation_log
from grape.messages import Array
from grape.robots import ArmDescription

R = TypeVar("R")


@dataclass(frozen=True, kw_only=True, eq=False)
class Beat:
    """One beat of a motion.

    Attributes:
        status, progress: what the action said it was doing, and how much of it was done, 0..1.
        q, speed: (n,) rad and rad/s, as the robot has them.
        T_told, T_true: (4, 4) `T_base_hand` by those angles, and as it is.
    """

    time_s: float
    status: str
    progress: float
    q: Array
    speed: Array
    T_told: Array
    T_true: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What came of one action.

    Attributes:
        result: of the action; None when it failed for a `reason`.
        touched: pairs of parts that touched for the first time though they should not.
    """

    beats: Sequence[Beat]
    result: Any
    reason: str
    detail: str
    touched: Sequence[Sequence[str]]

    @property
    def duration_s(self) -> float:
        """From its first beat to its last."""
        return self.beats[-1].time_s - self.beats[0].time_s if self.beats else 0.0

    def during(self, status: str) -> list[Beat]:
        """The beats in which the action said so."""
        return [beat for beat in self.beats if beat.status == status]

    def speed_share(self, arm: ArmDescription) -> float:
        """Fastest joint speed, as a share of the joint's limit."""
        return max((float((np.abs(beat.speed) / arm.velocity_max).max()) for beat in self.beats), default=0.0)


def cable_share(arm: ArmDescription, q: Array) -> float:
    """How far the continuous joints are wound at angles q (n,) rad, as a share of what their cables allow."""
    wound = np.abs(np.asarray(q) - arm.unwound)[~np.isfinite(arm.position_max)]
    return float(wound.max() / arm.cable_turns)


def off_line_m(points: Array, a: Array, b: Array) -> Array:
    """Distances (n,) of points (n, 3) from the straight line through `a` and `b` (3,)."""
    along = (b - a) / np.linalg.norm(b - a)
    offset = np.asarray(points) - a
    return np.asarray(np.linalg.norm(offset - np.outer(offset @ along, along), axis=1))


def bend_m(points: Array) -> float:
    """Largest distance of points (n, 3) from the straight line that fits them best."""
    points = np.asarray(points)
    middle = points.mean(axis=0)
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    return float(off_line_m(points, middle, middle + along).max())


def turned_rad(rotations: Iterable[Array], R_held: Array) -> float:
    """Largest angle between rotations (3, 3) and one that should have been held."""
    return max(float(np.linalg.norm(rotation_log(R @ R_held.T))) for R in rotations)


class BrokenArm:
    """An arm of which one joint moves by `factor` of what it is told, once that is `due`."""

    def __init__(self, arm: ArmDriver, joint: int, factor: float, due: Callable[[], bool]) -> None:
        self._arm, self._joint, self._factor, self._due = arm, joint, factor, due
        self._broken = False

    def send(self, velocity: Array) -> Array:
        """As the arm's, but for the joint."""
        self._broken = self._broken or self._due()
        told = np.array(velocity, float)
        if self._broken:
            told[self._joint] *= self._factor
        return self._arm.send(told)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arm, name)


class TrackedBench(ArmBench):
    """An `ArmBench` that keeps every beat of the motion at hand; arguments are the same."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._beats: list[Beat] = []
        self._status, self._status_since, self._progress = "", 0.0, 0.0
        super().__init__(*args, **kwargs)

    def observe(self, action: Generator[Feedback, None, Any], limit_s: float = 120.0) -> Motion:
        """Run an action to its end, whatever that is."""
        self._beats, before = [], len(self.simulation.referee.collisions)
        result, reason, detail = None, "", ""
        try:
            result = self.run(self._heard(action), limit_s)
        except ActionFailed as failure:
            reason, detail = str(failure.reason), failure.detail
        touched = [(c.a, c.b) for c in self.simulation.referee.collisions[before:]]
        return Motion(beats=self._beats, result=result, reason=reason, detail=detail, touched=touched)

    def has_done(self, status: str, seconds: float) -> bool:
        """Whether the action says that it is doing something, and has said so for a while."""
        return self._status == status and self.ctx.clock.now() - self._status_since >= seconds

    def break_joint(self, joint: int, factor: float, status: str, seconds: float) -> None:
        """Once that has gone on for a while, a joint moves by `factor` of what it is told: 0 stands still."""
        arm = BrokenArm(self.ctx.drivers.arm, joint, factor, lambda: self.has_done(status, seconds))
        self.ctx.arm = Actuator(cast("ArmDriver", arm))

    def _heard(self, action: Generator[Feedback, None, R]) -> Generator[Feedback, None, R]:
        """The action, its status kept for the beats that follow."""
        try:
            while True:
                feedback = next(action)
                if feedback.status != self._status:
                    self._status, self._status_since = feedback.status, self.ctx.clock.now()
                self._progress = feedback.progress or 0.0
                yield feedback
        except StopIteration as stop:
            result: R = stop.value
            return result
        finally:
            action.close()

    def _sense(self) -> None:
        super()._sense()
        arm = self.ctx.world.arm
        if arm is not None:
            self._beats.append(
                Beat(
                    time_s=self.ctx.clock.now(),
                    status=self._status,
                    progress=self._progress,
                    q=arm.position,
                    speed=arm.velocity,
                    T_told=self.robot.hand_pose(arm.position),
                    T_true=self.true_hand(),
                )
            )
