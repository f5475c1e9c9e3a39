"""What each geom of a scene belongs to, and which of them must not touch; for the referee."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import mujoco
import numpy as np

from grape.messages import Array
from grape.robots import RobotDescription
from grape.sim.compose import BASE_BODY, DISPENSER, WALKER_PREFIX, WORLD_PREFIX
from grape.sim.worlds.model import Capsule, Label, Plate, World


class Part(IntEnum):
    """Kinds of geoms, as far as touching goes."""

    NOTHING = 0  # not touchable
    GROUND = 1
    PLANT = 2  # vines, posts, wires, boards, nails in posts
    BODY = 3  # base, deck, feeder
    WHEEL = 4
    ARM = 5
    FINGER = 6
    NAIL = 7  # nails on the fingers
    DISPENSER = 8
    WALKER = 9  # people and animals


# Pairs that must not touch. Nails may touch plants gently when they place a loop; how gently is measured.
_FORBIDDEN = (
    (Part.BODY, Part.GROUND),
    (Part.ARM, Part.GROUND),
    (Part.FINGER, Part.GROUND),
    (Part.NAIL, Part.GROUND),
    (Part.BODY, Part.PLANT),
    (Part.WHEEL, Part.PLANT),
    (Part.ARM, Part.PLANT),
    (Part.FINGER, Part.PLANT),
    (Part.ARM, Part.BODY),
    (Part.ARM, Part.WHEEL),
    (Part.ARM, Part.ARM),
    (Part.FINGER, Part.BODY),
    (Part.FINGER, Part.WHEEL),
    (Part.FINGER, Part.ARM),
    (Part.NAIL, Part.BODY),
    (Part.NAIL, Part.WHEEL),
    (Part.NAIL, Part.ARM),
    (Part.BODY, Part.WALKER),
    (Part.WHEEL, Part.WALKER),
    (Part.ARM, Part.WALKER),
    (Part.FINGER, Part.WALKER),
    (Part.NAIL, Part.WALKER),
)
_MEASURED = (*_FORBIDDEN, (Part.NAIL, Part.PLANT))
_SOFT = (Label.WEED,)


@dataclass(frozen=True, kw_only=True)
class PartTable:
    """Kind, name and owner of every geom.

    Attributes:
        kinds: (geoms,) of `Part`.
        names: what a person calls the geom's part: the body of the robot, the plant or thing of the world.
        plants: id of the plant that a geom belongs to, or an empty string.
        labels: (geoms,) of `Label`, -1 outside the world.
        matrix: (parts, parts) bool, which of them must not touch.
        measured: (parts, parts) bool, those and others whose force counts.
    """

    kinds: Array
    names: tuple[str, ...]
    plants: tuple[str, ...]
    labels: Array
    matrix: Array
    measured: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, world: World, robot: RobotDescription) -> PartTable:
        """The table of a composed model."""
        in_world: list[Capsule | Plate] = [*world.capsules, *world.plates]
        things = {WORLD_PREFIX + thing.name: thing for thing in in_world}
        chains = _body_chains(model)
        kinds = np.zeros(model.ngeom, dtype=int)
        labels = np.full(model.ngeom, -1)
        names, plants = [], []
        for geom in range(model.ngeom):
            name, chain = model.geom(geom).name, chains[model.geom_bodyid[geom]]
            thing = things.get(name)
            touchable = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
            of_world = chain[0] == "world" or chain[0].startswith(WORLD_PREFIX)
            names.append(name.removeprefix(WORLD_PREFIX) or "ground" if of_world else chain[0])
            plants.append(thing.plant if thing is not None else "")
            if thing is not None:
                labels[geom] = thing.label
            if touchable:
                kinds[geom] = _kind(chain, labels[geom], robot)
        return cls(
            kinds=kinds, names=tuple(names), plants=tuple(plants), labels=labels,
            matrix=_among(_FORBIDDEN), measured=_among(_MEASURED),
        )  # fmt: skip

    def force_counts(self, pairs: Array) -> Array:
        """Of which contacts (n, 2) of geoms the force is to be measured: (n,) bool."""
        kinds = self.kinds[pairs]
        return self.measured[kinds[:, 0], kinds[:, 1]]

    def forbidden(self, first: int, second: int) -> bool:
        """Whether two geoms should not touch."""
        return bool(self.matrix[self.kinds[first], self.kinds[second]])

    def is_a(self, geom: int, part: Part) -> bool:
        """Whether a geom is of a kind."""
        return bool(self.kinds[geom] == part)

    def pair_names(self, first: int, second: int) -> tuple[str, str]:
        """The names of two geoms, the robot's own before the world's."""
        others = (Part.GROUND, Part.PLANT, Part.WALKER)
        a, b = sorted((first, second), key=lambda geom: (self.kinds[geom] in others, geom))
        return self.names[a], self.names[b]


def _among(pairs: tuple[tuple[Part, Part], ...]) -> Array:
    """(parts, parts) bool, both ways."""
    matrix = np.zeros((len(Part), len(Part)), dtype=bool)
    for a, b in pairs:
        matrix[a, b] = matrix[b, a] = True
    return matrix


def _body_chains(model: mujoco.MjModel) -> list[list[str]]:
    """Names of each body and its ancestors, itself first."""
    chains: list[list[str]] = []
    for body in range(model.nbody):
        name = model.body(body).name or "world"
        chains.append([name] if body == 0 else [name, *chains[model.body_parentid[body]]])
    return chains


def _kind(chain: list[str], label: int, robot: RobotDescription) -> Part:
    if any(body.startswith(DISPENSER) for body in chain):
        return Part.DISPENSER
    if chain[0].startswith(WALKER_PREFIX):
        return Part.WALKER
    if BASE_BODY not in chain:
        if label in _SOFT:
            return Part.NOTHING
        return Part.PLANT if label >= 0 and label != Label.GROUND else Part.GROUND
    if any(body in robot.gripper.nail_bodies for body in chain):
        return Part.NAIL
    if any(body.startswith("finger_") for body in chain):
        return Part.FINGER
    if any(body in robot.base.wheel_joints for body in chain):
        return Part.WHEEL
    return Part.ARM if "link_1" in chain else Part.BODY
