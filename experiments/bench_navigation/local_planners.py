"""How long a step of each local planner and an update of the local costmap take."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from grape.experiments.bench_manipulation import seconds
from grape.experiments.driving_bench import PLANNERS
from grape.experiments.driving_yard import T_BASE_LASER, Yard, scan_of, yard
from grape.geometry import pose as make_pose
from grape.geometry import rotation_z
from grape.messages import Array
from grape.navigation.beams import beams_from_scan
from grape.navigation.costmap import Layer, ObstacleLayer, PolygonLayer
from grape.navigation.follower import FollowerState, FollowerStep, LocalPlanner
from grape.navigation.grid import Costmap, GridSpec
from grape.navigation.layers import InflationLayer
from grape.navigation.path import Path
from grape.navigation.planner import plan_path
from grape.navigation.rolling import LayeredCostmap
from grape.proof import Comparison

SEED = 3
DRIVEN_S = 1.0  # before the step that is timed


def rows() -> list[Comparison]:
    """A costmap update of 10 m by 10 m at 5 cm, and one step of each planner past an obstacle in a lane."""
    place = yard(SEED)
    pose = place.goals[1].pose
    update = costmap_update(place, pose)
    costmap = update()
    path = plan_path(costmap, pose, place.goals[2].pose)
    names = [name for name in PLANNERS if name != "dwa_classic"]
    steps = [planner_step(PLANNERS[name](), path, pose, costmap) for name in names]
    field = partial(_distance, costmap)
    update_s, field_s, *step_s = seconds(update, field, *steps, rounds=15, repeats=5)
    goals = {"mppi": "<= 5"}
    titles = {"mppi": "step of mppi, 2,000 sequences of 56 controls"}
    return [
        Comparison(
            quantity="costmap update, 10 x 10 m at 5 cm: scan, fences, inflation", unit="ms",
            value=1e3 * update_s, value_goal="<= 3",
        ),
        Comparison(quantity="distance field of it, for dwa, teb and mppi", unit="ms", value=1e3 * field_s),
        *(
            Comparison(
                quantity=titles.get(name, f"step of {name}"), unit="ms",
                value=1e3 * taken, value_goal=goals.get(name, ""),
            )
            for name, taken in zip(names, step_s, strict=True)
        ),
    ]  # fmt: skip


def _distance(costmap: Costmap) -> Array:
    return Costmap(spec=costmap.spec, cost=costmap.cost).distance  # a costmap of its own, which has not made it yet


def costmap_update(place: Yard, pose: Array) -> Callable[[], Costmap]:
    """What comes with each scan: mark and clear, fences and inflation."""
    obstacles = ObstacleLayer(GridSpec.window(pose[:2], 10.0))
    layers: dict[str, Layer] = {"obstacles": obstacles, "fences": PolygonLayer(place.fences), "near": InflationLayer()}
    local = LayeredCostmap(layers, size=10.0)
    T_map_base = make_pose(rotation_z(pose[2]), (pose[0], pose[1], 0.0))
    scan = scan_of(place.circles, pose, np.random.default_rng(SEED))

    def update() -> Costmap:
        obstacles.integrate(beams_from_scan(scan, T_map_base, T_BASE_LASER))
        return local.update(pose)

    for _ in range(5):  # scans until what stands there counts as an obstacle
        update()
    return update


def planner_step(planner: LocalPlanner, path: Path, pose: Array, costmap: Costmap) -> Callable[[], FollowerStep]:
    """One step of a planner that has driven for a second, an ideal base below it."""
    state, twist = FollowerState(), np.zeros(2)
    for _ in range(round(DRIVEN_S / 0.1)):
        step = planner.step(state, path, pose, twist, costmap, 0.1)
        state, twist = step.state, np.array([step.v, step.w])
        pose = pose + 0.1 * np.array([step.v * np.cos(pose[2]), step.v * np.sin(pose[2]), step.w])
    return partial(planner.step, state, path, pose, twist, costmap, 0.1)
