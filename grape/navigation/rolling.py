"""Costmaps put together of named layers: a global one that stays, a local one that rolls with the robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grape.errors import InvalidInput, with_suggestion
from grape.messages import Array
from grape.navigation.costmap import Layer
from grape.navigation.grid import FREE, Costmap, GridSpec
from grape.plugins import LAYERS, load


class LayeredCostmap:
    """Layers painted one over the other, in the order they are named.

    Layers that have `move_to` roll along, layers that have `stand_at` are told the pose, layers that have `forget`
    can be cleared. Nothing is inflated unless a layer does it.

    Args:
        layers: by name.
        size: m, side of a square window that rolls with the robot, or
        spec: the grid that stays.
        background: cost where no layer says anything, FREE or UNKNOWN.
    """

    def __init__(
        self,
        layers: Mapping[str, Layer],
        *,
        size: float | None = None,
        spec: GridSpec | None = None,
        resolution: float = 0.05,
        background: int = FREE,
    ) -> None:
        if (size is None) == (spec is None):
            raise InvalidInput("a costmap either rolls (size) or stays (spec)")
        self.layers: dict[str, Any] = dict(layers)
        self._size, self._spec = size, spec
        self._resolution, self._background = resolution, background

    def layer(self, name: str) -> Any:
        """The layer of this name.

        Raises:
            InvalidInput: there is none.
        """
        if name not in self.layers:
            sentence = f"no layer {name!r}; there are {', '.join(self.layers)}"
            raise InvalidInput(with_suggestion(sentence, name, self.layers))
        return self.layers[name]

    def update(self, pose: Array) -> Costmap:
        """The costs now, with the robot at `pose` (3,) x y yaw in map.

        Raises:
            InvalidInput: the pose is not finite.
        """
        pose = np.asarray(pose, dtype=float)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise InvalidInput(f"a pose has 3 finite numbers, got {pose}")
        spec = self._spec or GridSpec.window(pose[:2], self._size or 0.0, self._resolution)
        cost = np.full((spec.rows, spec.columns), self._background, dtype=np.uint8)
        for layer in self.layers.values():
            if self._size is not None and hasattr(layer, "move_to"):
                layer.move_to(pose[:2])
            if hasattr(layer, "stand_at"):
                layer.stand_at(pose)
            layer.paint(cost, spec)
        return Costmap(spec=spec, cost=cost)

    def forget(self, centre: Array, radius: float) -> None:
        """Clear what layers remember within `radius` m of `centre` (2,)."""
        for layer in self.layers.values():
            if hasattr(layer, "forget"):
                layer.forget(centre, radius)


def layers_of(wanted: Mapping[str, Mapping[str, Any]]) -> dict[str, Layer]:
    """Layers by plugin, such as {"sonar": {"plugin": "obstacles", "spec": spec}, "near": {"plugin": "inflation"}}.

    The key `plugin` names an entry of the group `grape.costmap_layers`; the other keys are its arguments.

    Raises:
        InvalidInput: no plugin is named, or it does not take these arguments.
        PluginError: there is no such plugin.
    """
    made: dict[str, Layer] = {}
    for name, arguments in wanted.items():
        if "plugin" not in arguments:
            raise InvalidInput(f"layer {name!r} names no plugin")
        make = load(LAYERS, arguments["plugin"])
        try:
            made[name] = make(**{key: value for key, value in arguments.items() if key != "plugin"})
        except TypeError as error:
            raise InvalidInput(f"layer {name!r}: {error}") from error
    return made
