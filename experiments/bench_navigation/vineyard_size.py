"""How the time of a simulated step and of a plan grows with the vineyard."""

from __future__ import annotations

from contextlib import ExitStack, closing

import numpy as np

from grape.actions.shortest_way import footprint_of, route_options, site_surroundings
from grape.experiments.bench_manipulation import seconds
from grape.navigation.planner import PlannerOptions, plan_route
from grape.navigation.route import waypoints
from grape.proof import Comparison
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import VineyardOptions, World, generate_vineyard

ROWS_AND_VINES = ((1, 8), (3, 8), (8, 20), (16, 40))  # rows, and vines in each
USUAL, LARGE = 24, 640  # vines that are held against each other
BEATS = 10
STEPS_A_BEAT = 5
ROUNDS = 10
STEP = "simulation: a step of 2 ms of a driving robot, by number of vines"
PLAN = "costmap and plan to the far end of the last row, by number of vines"
GROWTH_GOAL = ">= 0.667"  # at most 1.5 times as long


def rows() -> list[Comparison]:
    """A robot that drives, and a plan along the last row, in vineyards of 8 to 640 vines that take turns."""
    worlds = {
        rows * vines: generate_vineyard(VineyardOptions(rows=rows, vines_per_row=vines, nails_per_row=1, seed=1))
        for rows, vines in ROWS_AND_VINES
    }
    with ExitStack() as scenes:
        options = SimulationOptions(dispensers=0)
        driven = [
            scenes.enter_context(closing(Simulation(world, DESCRIPTION, options=options))) for world in worlds.values()
        ]
        steps = seconds(*(lambda scene=scene: drive(scene) for scene in driven), rounds=ROUNDS)
    plans = seconds(*(lambda world=world: plan(world) for world in worlds.values()), rounds=3)
    return [
        *growth(
            STEP, "µs", dict(zip(worlds, (1e6 * t / (BEATS * STEPS_A_BEAT) for t in steps), strict=True)), GROWTH_GOAL
        ),
        *growth(PLAN, "ms", dict(zip(worlds, (1e3 * t for t in plans), strict=True))),
    ]


def drive(scene: Simulation) -> None:
    """Some beats straight on."""
    for _ in range(BEATS):
        scene.drivers.base.send(0.3, 0.0)
        scene.advance(STEPS_A_BEAT)


def plan(world: World) -> float:
    """Length (m) of the way from the start to the far end of the last row, the costmap painted anew."""
    site = world.site
    lateral = route_options(DESCRIPTION).lateral
    goal = np.array([*(site.rows[-1].line[-1] + [2.0, -lateral]), 0.0])
    start = np.array([*site.start, site.start_heading_rad])
    costs = site_surroundings(site, goal[None], DESCRIPTION.base).overall()
    stops = waypoints(site.rows, start, goal, route_options(DESCRIPTION))
    return plan_route(costs, start, stops, PlannerOptions(footprint=footprint_of(DESCRIPTION.base.footprint))).length


def growth(quantity: str, unit: str, values: dict[int, float], goal: str = "") -> list[Comparison]:
    """A line over the number of vines, and its end against the usual vineyard."""
    line = [Comparison(quantity=quantity, unit=unit, value=value, at=vines) for vines, value in values.items()]
    end = Comparison(
        quantity=f"{quantity}: {LARGE}", unit=unit, value=values[LARGE], peer=f"{USUAL} of them",
        peer_value=values[USUAL], ratio_goal=goal,
    )  # fmt: skip
    return [*line, end]
