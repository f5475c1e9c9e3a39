"""Row B1: how many of the true spurs of simulated vines the arm reaches from a stop, by kinematics alone."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grape.actions.robot import Robot, build_robot
from grape.geometry import inverse, pose, rotation_from_rpy, transform
from grape.messages import Array
from grape.proof import Experiment, Proof, Quantity, wilson95
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.worlds import SpurTruth, VineyardOptions, World, generate_vineyard
from grape.tasks.dispenser.actions.drive_to_plant import stop_pose
from grape.tasks.dispenser.stops import AZIMUTHS, PITCHES, Stop, first_stop, margins_of, orientations
from grape.tasks.dispenser.targets import HangTarget

STYLES = ("cordon", "gobelet")
BEFORE, BEHIND = Stop(ahead_m=0.22, beside_m=0.62), Stop(ahead_m=-0.22, beside_m=0.62)
WAYS = ("chosen stop", "vine 0.22 m before the arm", "vine 0.22 m behind the arm")
REACHED = 0.25  # least margin: singular value 0.02 m, 0.05 rad to a limit
USABLE_TILT_RAD, USABLE_HEIGHT_M, BESIDE_M = np.radians(50.0), (0.42, 1.25), 0.60
STOP_ERROR_M, STOP_ERROR_RAD = 0.015, np.radians(0.5)
NOTES = (
    "One vine a seed and style. A spur is reached when the arm can follow stand-off, descent, release and withdrawal "
    "in one branch, with a singular value of at least 0.02 m and 0.05 rad to joint limits, clear of robot and itself; "
    "the vine's own wood is left out.",
    "Usable spurs: at most 50 degrees from vertical, tip 0.42 to 1.25 m over the ground, 0.60 m from the trunk.",
    "Stops err by 15 mm and 0.5 degrees. At the stops before and behind, the hand has the six orientations that were "
    "tried there; at the chosen one it has ten.",
)


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """Looks at one vine of each style for every seed; vines that the folder has are not looked at again."""
    folder.mkdir(parents=True, exist_ok=True)
    robot = build_robot(DESCRIPTION)
    counts: dict[str, list[dict[str, Any]]] = {style: [] for style in STYLES}
    for k, seed in enumerate(seeds):
        for style in STYLES:
            progress(k / len(seeds), f"{style} vine of seed {seed}")
            file = folder / f"{style}_{seed}.json"
            if not file.exists():
                file.write_text(json.dumps(reached(robot, seed, style)), encoding="utf-8")
            counts[style].append(json.loads(file.read_text(encoding="utf-8")))
    return Proof(quantities=tuple(q for style in STYLES for q in _quantities(style, counts[style])), notes=NOTES)


def reached(robot: Robot, seed: int, style: str) -> dict[str, int]:
    """How many usable spurs a vine has, and how many of them are reached from each stop."""
    world = generate_vineyard(VineyardOptions(seed=seed, style=style, rows=1))  # type: ignore[arg-type]
    plant = f"r0v{1 + seed % 6}"
    spurs, rng = usable_spurs(world, plant), np.random.default_rng([seed, 9])
    stops = (first_stop(robot, "vine"), BEFORE, BEHIND)
    found = {"usable": len(spurs)}
    for name, stop in zip(WAYS, stops, strict=True):
        T_base_map = inverse(_standing(world, plant, stop, rng))
        azimuths = AZIMUTHS if name == WAYS[0] else AZIMUTHS[:3]
        margins = [
            margins_of(robot, orientations(in_base(spur, T_base_map), PITCHES, azimuths)).max() for spur in spurs
        ]
        found[name] = sum(bool(margin >= REACHED) for margin in margins)
    return found


def usable_spurs(world: World, plant: str) -> list[SpurTruth]:
    """Spurs of a vine on which a dispenser could hang."""
    foot = world.site.plant(plant).position
    ground = float(world.terrain.height(foot))
    low, high = (ground + height for height in USABLE_HEIGHT_M)
    return [
        spur
        for spur in world.spurs
        if spur.plant == plant
        and spur.direction[2] >= np.cos(USABLE_TILT_RAD)
        and low <= spur.tip[2] <= high
        and abs(spur.tip[0] - foot[0]) <= BESIDE_M
    ]


def in_base(spur: SpurTruth, T_base_map: Array) -> HangTarget:
    """A true spur as a target in base_link."""
    target = HangTarget(plant=spur.plant, kind="spur", tip=spur.tip, direction=spur.direction, pitch=PITCHES[0])
    direction = T_base_map[:3, :3] @ spur.direction
    return replace(target, tip=transform(T_base_map, spur.tip), direction=direction)


def _standing(world: World, plant: str, stop: Stop, rng: np.random.Generator) -> Array:
    """`T_map_base` of a robot that has driven to a stop."""
    x, y, yaw = stop_pose(DESCRIPTION, world.site, plant, stop)
    x, y = np.array([x, y]) + rng.normal(0.0, STOP_ERROR_M, 2)
    pitch = -np.arctan(world.terrain.slope) * np.cos(yaw)
    R = rotation_from_rpy(0.0, float(pitch), float(yaw + rng.normal(0.0, STOP_ERROR_RAD)))
    return pose(R, (x, y, float(world.terrain.height(np.array([x, y]))) + DESCRIPTION.base.height))


def _quantities(style: str, vines: list[dict[str, Any]]) -> list[Quantity]:
    usable = sum(vine["usable"] for vine in vines)
    quantities = []
    for way in WAYS:
        spurs = sum(vine[way] for vine in vines)
        rates = [("usable spurs reached", spurs, usable)]
        for least in (1, 3):
            enough = sum(vine[way] >= min(least, vine["usable"]) for vine in vines)
            rates.append((f"vines of which {least} or all usable spurs are reached", enough, len(vines)))
        quantities += [
            Quantity(name=f"{style}, {way}: {name}", unit="1", value=yes / n if n else None, n=n, ci95=wilson95(yes, n))
            for name, yes, n in rates
        ]
    return quantities


EXPERIMENT = Experiment(
    row="B1",
    summary="True spurs of simulated vines that the arm reaches from the chosen stop, and from before and behind.",
    seeds=range(500, 600),
    run=run,
)
