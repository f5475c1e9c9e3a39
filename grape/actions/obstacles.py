"""What was perceived around the arm, as the planners need it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grape.actions.core import Context
from grape.messages import Array, frozen_array
from grape.planning import Ball, DistanceField, build_distance_field, carve_distance_field

# In world.committed, valid until the base moves:
OBSTACLES = "obstacles"  # `Obstacles`: what was seen from this stop
UNSEEN = "unseen"  # tuple of StaticBox in base_link: where things stand that nobody has looked at from this stop
OBSTACLES_UP = "obstacles_up"  # in the ledger's memory of this stop, beside the cloud: its `Obstacles.up`


class Obstacles:
    """A cloud in base_link and its distance fields, each computed once.

    Args:
        cloud: (n, 3) m.
        up: (3,) unit vector against gravity in base_link when it was seen; None: unknown.
    """

    def __init__(self, cloud: Array, up: Array | None = None) -> None:
        self.cloud = frozen_array(cloud, float)
        self.up = up
        self._fields: dict[tuple[tuple[float, ...], ...], DistanceField] = {}

    def field(self, carve: Sequence[Ball] = ()) -> DistanceField:
        """The distance field without what is inside balls (centre (3,) m, radius m)."""
        key = tuple((*(float(v) for v in centre), float(radius)) for centre, radius in carve)
        if () not in self._fields:
            self._fields[()] = build_distance_field(self.cloud)
        if key not in self._fields:
            self._fields[key] = carve_distance_field(self._fields[()], self.cloud, carve)
        return self._fields[key]


def remember_obstacles(ctx: Context, seen: Obstacles) -> None:
    """Keeps what was seen for a resumed mission that finds the robot at the same stop."""
    ctx.ledger.remember(OBSTACLES_UP, None if seen.up is None else seen.up.tolist())
    ctx.ledger.remember(OBSTACLES, seen.cloud.astype(np.float32).tobytes())


def recall_obstacles(ctx: Context) -> Obstacles | None:
    """What `remember_obstacles` has kept at this stop; None when nothing was."""
    cloud, up = ctx.ledger.recall(OBSTACLES), ctx.ledger.recall(OBSTACLES_UP)
    if cloud is None:
        return None
    return Obstacles(np.frombuffer(cloud, np.float32).reshape(-1, 3), None if up is None else np.array(up))
