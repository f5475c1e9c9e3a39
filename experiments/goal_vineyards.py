"""Vineyards drawn for driving to plants: on slopes, with rough ground, and with a vehicle in the lane next door."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grape.actions.drive_to_pose import DriveGoal
from grape.messages import Array
from grape.robots import RobotDescription
from grape.sim.worlds import Capsule, Label, VineyardOptions, World, generate_vineyard
from grape.tasks.dispenser.actions.drive_to_plant import stop_pose
from grape.tasks.dispenser.stops import VINE_STOPS, Stop

STEEP_DEG = (5.0, 10.0)
GENTLE_DEG = (0.0, 3.0)
ROWS, VINES = 3, 5
VEHICLE_RADIUS_M = 0.45
VEHICLE_M = 2.2  # long
HEIGHTS_M = (0.60, 1.00)  # of the middle of its rods over the ground
RED = (0.55, 0.20, 0.15, 1.0)
OUT_M = (0.0, 1.0)  # how far it stands out of its lane into the headland


@dataclass(frozen=True, kw_only=True)
class Task:
    """One drive. Attributes: kind: what kind of drive it is; plant: beside which it ends."""

    kind: str
    plant: str
    goal: DriveGoal


@dataclass(frozen=True, kw_only=True)
class Tour:
    """A vineyard and drives one after the other.

    Attributes:
        slope_deg: of the ground along the rows.
        vehicle: (4, 2) m, outline of what stands in the lane that the change of row passes; None where it is free.
    """

    world: World
    tasks: tuple[Task, ...]
    slope_deg: float
    vehicle: Array | None = None


def tour(seed: int, description: RobotDescription, planner: str) -> Tour:
    """Four drives of one seed: into a row, on to another plant, over to the next row, round into the lane again.

    Odd seeds are steep. Of every four seeds, the last two have a vehicle in the lane that the change of row passes.
    """
    rng = np.random.default_rng([seed, 15])
    slope_deg = float(rng.choice((-1.0, 1.0)) * rng.uniform(*(STEEP_DEG if seed % 2 else GENTLE_DEG)))
    options = VineyardOptions(
        seed=seed,
        style="gobelet" if rng.random() < 0.5 else "cordon",
        rows=ROWS,
        vines_per_row=VINES,
        nails_per_row=0,
        row_spacing=float(rng.uniform(2.4, 2.9)),
        vine_spacing=float(rng.uniform(1.0, 1.3)),
        slope=float(np.tan(np.radians(slope_deg))),
        roughness_rms=float(rng.uniform(0.01, 0.025)),
    )
    world = generate_vineyard(options)
    front = float(world.site.rows[0].line[-1, 0] + rng.uniform(*OUT_M))
    vehicle = _box((front - VEHICLE_M, front), 0.5 * options.row_spacing) if seed // 2 % 2 else None
    if vehicle is not None:
        world = _with_vehicle(world, vehicle)
    plants = ("row entry", f"r0v{rng.integers(0, 2)}"), ("along the row", f"r0v{rng.integers(3, VINES)}")
    changes = ("row change", f"r1v{rng.integers(0, VINES)}"), ("turn round", f"r2v{rng.integers(0, VINES)}")
    tasks = tuple(_task(world, description, rng, kind, plant, planner) for kind, plant in (*plants, *changes))
    return Tour(world=world, tasks=tasks, slope_deg=slope_deg, vehicle=vehicle)


def _task(
    world: World, description: RobotDescription, rng: np.random.Generator, kind: str, plant: str, planner: str
) -> Task:
    ahead = [x for x in VINE_STOPS.ahead_m if abs(x) <= VINE_STOPS.first_within_m]
    stop = Stop(ahead_m=float(rng.choice(ahead)), beside_m=float(rng.choice(VINE_STOPS.beside_m)))
    x, y, yaw = (float(value) for value in stop_pose(description, world.site, plant, stop))
    return Task(kind=kind, plant=plant, goal=DriveGoal(x=x, y=y, yaw=yaw, planner=planner))


def _box(x: tuple[float, float], y: float) -> Array:
    """(4, 2) m, outline of a vehicle between two x, its middle at y."""
    low, high = y - VEHICLE_RADIUS_M, y + VEHICLE_RADIUS_M
    return np.array([[x[0], low], [x[1], low], [x[1], high], [x[0], high]])


def _with_vehicle(world: World, outline: Array) -> World:
    """A vehicle on its outline: two level rods, one over the other, from 15 cm to 1.45 m over the ground."""
    (rear, low), (front, high) = outline[0], outline[2]
    ends = np.array([[rear + VEHICLE_RADIUS_M, 0.5 * (low + high)], [front - VEHICLE_RADIUS_M, 0.5 * (low + high)]])
    rods = []
    for k, above_m in enumerate(HEIGHTS_M):
        p0, p1 = np.column_stack([ends, world.terrain.height(ends) + above_m])
        name = f"vehicle/body{k}"
        rods.append(Capsule(name=name, p0=p0, p1=p1, radius=VEHICLE_RADIUS_M, label=Label.POST, rgba=RED))
    return replace(world, capsules=(*world.capsules, *rods))
