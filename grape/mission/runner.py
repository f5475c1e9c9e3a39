"""One mission from its first beat to its run folder: sense, tick, act, advance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from grape.actions.account import RESUMED
from grape.actions.core import Context, InlineJobs, Outcome, Status
from grape.clock import Clock, MonotonicClock
from grape.drivers import Drivers
from grape.errors import GrapeError, Reason
from grape.mapping import plants_in_scan
from grape.messages import Array, Odometry
from grape.mission.drive_record import DriveRecord
from grape.mission.file import OF_SITE, Mission
from grape.mission.guard import guarded
from grape.mission.laser_motion import LaserMotion
from grape.mission.laser_place import LaserPlace
from grape.mission.ledger import SqliteLedger
from grape.mission.progress import Progress, ProgressTracker
from grape.mission.record import RunRecorder
from grape.mission.sense import Sensing
from grape.mission.track import Track
from grape.world import World

BEAT_S = 0.01
LATE_S = 0.05  # an arm stops by itself when it hears nothing for so long
STOPPING_S = 1.0  # after the end, so that the robot stands when the referee looks
TRACK_PERIOD_S = 0.2
PROGRESS_PERIOD_S = 0.25  # of the wall clock
ASKED_S = 0.05  # an action that fails sooner was a question, and "no" is its answer
LOOKS = ("check", "settled")  # events after which the referee notes where the dispensers are


class Referee(Protocol):
    """Who knows the truth; its findings reach the run folder alone."""

    def observe(self, estimate: Odometry | None = None) -> None: ...

    def witness(self, check: str, plant: str) -> None: ...

    def verdict(self) -> dict[str, Any]: ...

    def standing(self) -> Array: ...


class Backend(Protocol):
    """What a mission runs on: a simulation, or the real robot."""

    @property
    def clock(self) -> Clock: ...

    @property
    def drivers(self) -> Drivers: ...

    def advance(self) -> None:
        """Let one beat (10 ms) pass."""
        ...


class Tree(Protocol):
    """A behaviour tree that is being executed."""

    def tick(self) -> Status: ...

    def halt(self) -> None: ...

    @property
    def last_failure(self) -> Any:
        """The newest action that failed, with path, reason and detail; None when there is none."""
        ...


@dataclass(kw_only=True)
class Finding:
    """How a run ended, before it is written down.

    Attributes:
        ended_by: tree, time_limit, aborted or crash.
        detail: what broke, or which action made the tree fail.
        succeeded: whether the tree did.
    """

    ended_by: str = "tree"
    detail: str = ""
    succeeded: bool = False
    sim_time_s: float = 0.0
    wall_time_s: float = 0.0
    track: Track = field(default_factory=Track)


class Runner:
    """Runs one mission on a backend and fills its folder with events and the ledger.

    Args:
        robot: models and description (`grape.actions.robot.Robot`).
        make_tree: from a context to the tree to execute.
        referee: None on a real robot.
        cancelled: asked every beat; true ends the mission as aborted.
        on_progress: called a few times a second of the wall clock.
        on_beat: called after every beat with the time; for pictures.
        resume: go on with the mission whose ledger, events and track are in the folder, as far as they are there.
        facts: what to write into a new ledger about the mission as a whole.
    """

    def __init__(
        self,
        mission: Mission,
        backend: Backend,
        robot: Any,
        folder: Path,
        *,
        make_tree: Callable[[Context], Tree],
        referee: Referee | None = None,
        cancelled: Callable[[], bool] = lambda: False,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        on_beat: Callable[[float], None] = lambda now: None,
        resume: bool = False,
        facts: Mapping[str, str] | None = None,
    ) -> None:
        self._mission = mission
        self._backend = backend
        self._referee = referee
        self._cancelled = cancelled
        self._on_progress = on_progress
        self._on_beat = on_beat
        self._live = False  # while events of earlier sessions are shown
        self._tracker = ProgressTracker([plant.plant for plant in mission.plants])
        self.log = RunRecorder(folder, backend.clock, observer=self._see, resume=resume)
        self._live = True
        self._track = Track(folder / "track.csv")
        self._earlier_s = self._track.wall_s
        antenna = robot.description.T_base_link_sensor("gnss_link")[:3, 3]
        self._drives = DriveRecord(folder / "drive.jsonl", robot.description.base, antenna)
        self.ledger = _ledger(mission, folder / "ledger.sqlite", resume, facts or {})
        self._session = int(self.ledger.facts().get("sessions", 0)) + 1
        self.ledger.note("sessions", str(self._session))
        world = World(site=mission.site)
        self.context = Context(
            clock=backend.clock,
            world=world,
            drivers=guarded(backend.drivers, robot, world, backend.clock, self.log),
            robot=robot,
            jobs=InlineJobs(),
            log=self.log,
            ledger=self.ledger,
            rng=np.random.default_rng([mission.seed, 7, *([self._session] if self._session > 1 else [])]),
            config=mission.actions,
        )
        motion = LaserMotion(backend.drivers, robot.description) if mission.file.laser_odometry else None
        self._sensing = Sensing(backend.drivers, self.context.world, robot, self._place(robot.description), motion)
        self._make_tree = make_tree

    def run(self) -> Finding:
        """Beat until the tree ends, time is up, somebody cancels, or something breaks; the robot stands afterwards."""
        wall = MonotonicClock()
        finding = Finding(track=self._track)
        if self._session > 1:
            self._take_up()
        else:
            self.log.event("mission_started", mission=self._mission.name, seed=self._mission.seed)
        tree: Tree | None = None
        try:
            tree = self._make_tree(self.context)
            finding.ended_by, status = self._beat(tree, wall)
            finding.succeeded = status is Status.SUCCEEDED
            if status is Status.ABORTED and tree.last_failure is not None:
                failure = tree.last_failure
                finding.detail = f"{failure.path}: {failure.reason}: {failure.detail}"
        except KeyboardInterrupt:
            finding.ended_by = "aborted"
        except Exception as error:  # whatever broke, the robot stops and the folder is completed
            finding.ended_by, finding.detail = "crash", f"{type(error).__name__}: {error}"
        finding.sim_time_s = self._backend.clock.now()
        finding.wall_time_s = self._earlier_s + wall.now()
        self._stop(tree, finding)
        self._close_account(finding)
        self.log.event("mission_ended", ended_by=finding.ended_by, detail=finding.detail)
        return finding

    def close(self) -> None:
        """Close the files of the folder."""
        self.log.close()
        self._track.close()
        self._drives.close()
        self.ledger.close()

    def _place(self, description: Any) -> LaserPlace | None:
        """AMCL on the mission's map, where it has one."""
        mission = self._mission
        if mission.map is None:
            return None
        seen = {"seen": plants_in_scan} if mission.file.map == OF_SITE else {}
        chance = np.random.default_rng([mission.seed, 8, self._session])
        return LaserPlace(mission.map, self._backend.drivers, description, chance, self.log, **seen)

    def _see(self, event: dict[str, Any]) -> None:
        """Follow the robot's account; whenever it has looked, let the referee note what was so."""
        self._tracker.observe(event)
        if not self._live:
            return
        if self._referee is not None and event["kind"] in LOOKS:
            self._referee.witness(str(event.get("check", event["kind"])), self._tracker.plant)
        if event["kind"] == "action" and event["status"] == "aborted" and event["end"] - event["start"] > ASKED_S:
            self._keep_view(f"failed_{event['name']}")

    def _keep_view(self, name: str) -> None:
        """What the camera sees now, for a person who asks why something failed."""
        try:
            image = self.context.camera.latest(max_age_s=1.0)
        except GrapeError as error:
            self.log.event("no_picture", name=name, error=str(error))
        else:
            self.log.picture(name, image.bgr)

    def _take_up(self) -> None:
        """Go on where a kill or Ctrl-C has ended an earlier session."""
        self.ledger.reopen("aborted")
        last = self.ledger.last_step()
        self.log.event(
            "mission_resumed",
            session=self._session,
            step=last.name if last else "",
            plant=last.plant if last else "",
            outcome=last.outcome if last else None,
        )
        for task in self.ledger.plants():  # outcomes that were written down but not yet told
            if task.outcome is not None and task.plant not in self._tracker.finished:
                self.log.event("plant_finished", plant=task.plant, outcome=str(task.outcome), reason=task.reason)
        self.context.world.committed[RESUMED] = True

    def _beat(self, tree: Tree, wall: MonotonicClock) -> tuple[str, Status]:
        clock, next_track, next_progress = self._backend.clock, 0.0, 0.0
        while True:
            now = clock.now()
            self._sensing.update(now)
            odometry = self.context.world.odometry
            if self._referee is not None:
                self._referee.observe(odometry)
            if odometry is not None and now >= next_track:
                self._track.add(now, odometry.pose, float(odometry.linear[0]), self._earlier_s + wall.now())
                next_track = now + TRACK_PERIOD_S - 1e-6
            self._drives.observe(now, self.context.world, self._backend.drivers)
            if now >= self._mission.file.time_limit_s:
                return "time_limit", Status.ACTIVE
            if self._cancelled():
                return "aborted", Status.ACTIVE
            status = tree.tick()
            if status is not Status.ACTIVE:
                return "tree", status
            self._backend.advance()
            if clock.now() - now > LATE_S:  # never in simulation
                self.log.event("late_beat", took_s=round(clock.now() - now, 3))
            self._on_beat(now)
            if wall.now() >= next_progress:
                self._on_progress(self._tracker.progress(now, self._earlier_s + wall.now()))
                next_progress = wall.now() + PROGRESS_PERIOD_S

    def _stop(self, tree: Tree | None, finding: Finding) -> None:
        """Halt every action, stop every actuator, and let the machine come to rest."""
        try:
            try:
                if tree is not None:
                    tree.halt()
            finally:  # also when an action cannot be halted
                self._backend.drivers.stop_all()
                for _ in range(round(STOPPING_S / BEAT_S)):
                    self._backend.advance()
                    if self._referee is not None:
                        self._referee.observe()
        except Exception as error:  # a machine that cannot be stopped by its drivers is beyond us: say so
            finding.detail = f"{finding.detail} stopping failed: {type(error).__name__}: {error}".strip()

    def _close_account(self, finding: Finding) -> None:
        """Give every plant that was not served a reason."""
        current = self._tracker.plant
        empty = self.ledger.dispensers()["feeder"] == 0 or self.context.world.committed.get("feeder_empty")
        for task in self.ledger.plants():
            if task.outcome is not None:
                continue
            if finding.ended_by == "crash" and task.plant == current:
                self.ledger.finish(task.plant, Outcome.FAILED, Reason.INTERNAL_ERROR)
                continue
            why = finding.ended_by if finding.ended_by != "tree" else Reason.FEEDER_EMPTY if empty else "not_served"
            self.ledger.finish(task.plant, Outcome.SKIPPED, "not_served" if why == "crash" else why)


def _ledger(mission: Mission, path: Path, resume: bool, facts: Mapping[str, str]) -> SqliteLedger:
    if resume and path.exists():
        return SqliteLedger.open(path)
    pairs = [(plant.plant, plant.mode) for plant in mission.plants]
    return SqliteLedger.create(path, pairs, mission.file.dispensers, facts, mission.stock)
