"""The referee: the only one who sees the truth, and who tells it to the run folder alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np

from grape.geometry import wrap_angle, yaw_of
from grape.messages import Array, Odometry
from grape.robots import RobotDescription
from grape.sim.areas import polygons_touch
from grape.sim.compose import BASE_BODY
from grape.sim.encounters import Encounters
from grape.sim.hanging import DispenserPlace, HangingJudge, census
from grape.sim.parts import Part, PartTable
from grape.sim.physics import Physics
from grape.sim.standing import standing_cells
from grape.sim.worlds.model import World
from grape.sim.worlds.walkers import Walkers

_PATH_PERIOD_STEPS = 100  # 5 Hz
_FENCE_PERIOD_STEPS = 50


@dataclass(kw_only=True)
class Collision:
    """Two parts that touched though they should not: when first, and how hard at most."""

    a: str
    b: str
    force_n: float
    time_s: float


@dataclass(kw_only=True)
class _Errors:
    STATE: ClassVar[tuple[str, ...]] = ("count", "squared_m2", "squared_rad2", "largest_m")
    count: int = 0
    squared_m2: float = 0.0
    squared_rad2: float = 0.0
    largest_m: float = 0.0

    def add(self, distance: float, angle: float) -> None:
        self.count += 1
        self.squared_m2 += distance**2
        self.squared_rad2 += angle**2
        self.largest_m = max(self.largest_m, distance)

    def summary(self) -> dict[str, float | None]:
        if not self.count:
            return {"position_rmse_m": None, "yaw_rmse_deg": None, "max_error_m": None}
        return {
            "position_rmse_m": float(np.sqrt(self.squared_m2 / self.count)),
            "yaw_rmse_deg": float(np.degrees(np.sqrt(self.squared_rad2 / self.count))),
            "max_error_m": self.largest_m,
        }


@dataclass(frozen=True, kw_only=True)
class Witness:
    """What was so when the robot looked: where the dispensers were, and whether the plant in hand had one.

    Attributes:
        true: what the check should have said; None for a look that answers no question the referee knows.
        level: of the topmost dispenser in the feeder, 0 is the lowest; None when there is none.
        places: how many dispensers were where: feeder, hand, dropped, or a plant's id.
    """

    time_s: float
    check: str
    plant: str
    true: bool | None
    in_feeder: int
    on_hand: int
    hanging: bool
    level: int | None = None
    places: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PathSample:
    """Where base_link really was (m, rad, map frame), and how far off the robot's own estimate was."""

    time_s: float
    x: float
    y: float
    yaw: float
    error_m: float | None = None


@dataclass(kw_only=True)
class _Fences:
    STATE: ClassVar[tuple[str, ...]] = ("inside", "crossings")
    polygons: tuple[Array, ...]
    inside: Array = field(init=False)  # (fences,) bool
    crossings: int = 0

    def __post_init__(self) -> None:
        self.inside = np.zeros(len(self.polygons), dtype=bool)

    def observe(self, footprint: Array) -> None:
        now = np.array([polygons_touch(footprint, polygon) for polygon in self.polygons], dtype=bool)
        self.crossings += int(np.count_nonzero(now & ~self.inside))
        self.inside = now


class Referee:
    """Watches a scene and judges it.

    Args:
        physics: the scene.
        world: what stands in it, with the truth about spurs and nails.
        robot: whose footprint must stay out of the fences.
        walkers: from whom it must keep away.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_max_plant_force",)

    def __init__(self, physics: Physics, world: World, robot: RobotDescription, walkers: Walkers) -> None:
        self._physics = physics
        self._world = world
        self._parts = PartTable.of(physics.model, world, robot)
        self._judge = HangingJudge(physics, world, self._parts, robot.feeder.pitch)
        self._footprint = robot.base.footprint
        self._fences = _Fences(polygons=tuple(fence.polygon for fence in world.site.fences))
        self._encounters = Encounters(walkers, robot.base.footprint) if walkers.ids else None
        self._base = physics.identify("body", BASE_BODY)
        self._collisions: dict[tuple[str, str], Collision] = {}
        self._max_plant_force = 0.0
        self._harmless = b""  # the last pairs of geoms in contact that may be: mostly the next step has the same
        self._errors = _Errors()
        self._path: list[PathSample] = []
        self._witnessed: list[Witness] = []
        self._news: list[PathSample | Collision | Witness] = []  # since the last checkpoint

    @property
    def path(self) -> tuple[PathSample, ...]:
        """The true path so far, five samples a second."""
        return tuple(self._path)

    @property
    def collisions(self) -> tuple[Collision, ...]:
        """Every pair of parts that touched though they should not."""
        return tuple(self._collisions.values())

    def watch(self) -> None:
        """Look at the contacts of the last physics step; the simulation calls it after each."""
        pairs = self._physics.data.contact.geom
        seen = pairs.tobytes()
        if seen == self._harmless:
            return
        watched = np.flatnonzero(self._parts.force_counts(pairs))
        if not watched.size:
            self._harmless = seen
            return
        forces: dict[tuple[str, str], float] = {}
        collided: set[tuple[str, str]] = set()
        wrench = np.zeros(6)
        for k in watched:
            first, second = (int(geom) for geom in pairs[k])
            mujoco.mj_contactForce(self._physics.model, self._physics.data, int(k), wrench)
            key = self._parts.pair_names(first, second)
            forces[key] = forces.get(key, 0.0) + abs(float(wrench[0]))
            if self._parts.is_a(first, Part.PLANT) or self._parts.is_a(second, Part.PLANT):
                self._max_plant_force = max(self._max_plant_force, forces[key])
            if self._parts.forbidden(first, second):
                collided.add(key)
        for key, force in forces.items():
            if key not in collided:
                continue
            known = self._collisions.setdefault(
                key, Collision(a=key[0], b=key[1], force_n=0.0, time_s=self._physics.clock.now())
            )
            if force > known.force_n:
                known.force_n = force
                if known not in self._news:
                    self._news.append(known)

    def observe(self, estimate: Odometry | None = None) -> None:
        """Look at where the robot is; call it once a beat.

        Args:
            estimate: the robot's own estimate of base_link in the map, to be held against the truth.
        """
        T_map_base = self.true_pose()
        error_m = self._compare(T_map_base, estimate)
        step = self._physics.clock.step
        if step % _FENCE_PERIOD_STEPS < 5:
            footprint = self._footprint @ T_map_base[:2, :2].T + T_map_base[:2, 3]
            self._fences.observe(footprint)
        if self._encounters is not None:
            self._encounters.observe(T_map_base, self._physics.clock.now())
        if step % _PATH_PERIOD_STEPS < 5:
            x, y = (float(value) for value in T_map_base[:2, 3])
            now = self._physics.clock.now()
            self._path.append(PathSample(time_s=now, x=x, y=y, yaw=yaw_of(T_map_base), error_m=error_m))
            self._news.append(self._path[-1])

    def witness(self, check: str, plant: str) -> None:
        """Remember what is so at this moment, for the run folder alone: the robot has just looked.

        Args:
            check: feeder (holds a dispenser?), grasp (is one on the hand?) or deployment (does one hang on the plant?);
                of another look only the places are noted.
            plant: the plant in hand, or empty.
        """
        places = self._judge.places()
        found = census(places)
        in_feeder, on_hand = found["feeder"], found["hand"]
        hanging = found.get(plant, 0) > 0
        true = {"feeder": in_feeder > 0, "grasp": on_hand > 0, "deployment": hanging}.get(check)
        witness = Witness(
            time_s=round(self._physics.clock.now(), 3),
            check=check,
            plant=plant,
            true=true,
            in_feeder=in_feeder,
            on_hand=on_hand,
            hanging=hanging,
            level=max((place.level for place in places if place.level is not None), default=None),
            places=found,
        )
        self._witnessed.append(witness)
        self._news.append(witness)

    def verdict(self) -> dict[str, Any]:
        """What really happened, as `truth` and `localization` of result.json."""
        places = self._judge.places()
        found = census(places)
        hanging = {place.plant: place for place in places if place.plant is not None}
        plants = {
            plant.id: {
                "hanging": plant.id in hanging,
                "offset_mm": round(hanging[plant.id].offset_mm, 1) if plant.id in hanging else None,
            }
            for plant in self._judge.plants
        }
        return {
            "truth": {
                "loaded": sum(place.where != DispenserPlace.STOCK for place in places),
                "hanging": sorted(hanging),
                "dropped": found["dropped"],
                "in_feeder": found["feeder"],
                "on_hand": found["hand"],
                "places": found,
                "collisions": [
                    {"a": c.a, "b": c.b, "force_n": round(c.force_n, 2), "time_s": round(c.time_s, 3)}
                    for c in self._collisions.values()
                ],
                "fence_crossings": self._fences.crossings,
                "max_plant_force_n": round(self._max_plant_force, 2),
                "plants": plants,
                "checks": [asdict(witness) for witness in self._witnessed],
                **({} if self._encounters is None else self._encounters.summary(self._collisions)),
            },
            "localization": self._errors.summary(),
        }

    def standing(self) -> Array:
        """(n, 2) m in map, what stands in the world at the height of the robot, as middles of cells."""
        return standing_cells(self._world)

    @property
    def tallies(self) -> tuple[Any, ...]:
        """The objects whose numbers a checkpoint of the world keeps."""
        return self, self._errors, self._fences, *(() if self._encounters is None else (self._encounters,))

    def news(self) -> list[dict[str, Any]]:
        """What has grown since the last call, for a checkpoint's journal."""
        news, self._news = self._news, []
        step = self._physics.clock.step
        return [{"step": step, "kind": type(entry).__name__, **asdict(entry)} for entry in news]

    def recall(self, journal: Iterable[dict[str, Any]]) -> None:
        """Take up what an earlier process has told by `news`."""
        for entry in journal:
            fields = {name: value for name, value in entry.items() if name not in ("step", "kind")}
            if entry.get("kind") == "PathSample":
                self._path.append(PathSample(**fields))
            elif entry.get("kind") == "Collision":
                self._collisions[entry["a"], entry["b"]] = Collision(**fields)
            elif entry.get("kind") == "Witness":
                self._witnessed.append(Witness(**fields))

    def true_pose(self, body: str = BASE_BODY) -> Array:
        """`T_map_body` (4, 4) of a body of the model as it really is; by default the robot's base."""
        data, index = self._physics.data, self._base if body == BASE_BODY else self._physics.identify("body", body)
        T = np.eye(4)
        T[:3, :3] = data.xmat[index].reshape(3, 3)
        T[:3, 3] = data.xpos[index]
        return T

    def _compare(self, T_map_base: Array, estimate: Odometry | None) -> float | None:
        if estimate is None:
            return None
        distance = float(np.linalg.norm(estimate.pose[:2, 3] - T_map_base[:2, 3]))
        self._errors.add(distance, float(wrap_angle(yaw_of(estimate.pose) - yaw_of(T_map_base))))
        return distance
