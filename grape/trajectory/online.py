"""Set-points that are made while moving: limited in speed, acceleration and jerk."""

from __future__ import annotations

from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array


class VelocityLimiter:
    """Turns wished speeds of an arm's joints or of a base into ones that it can follow.

    Args:
        velocity_max: (n,) rad/s, or m/s of a base that drives straight.
        acceleration_max: (n,) per s^2.
        period_s: time between two calls of `step`.
        jerk_max: (n,) per s^3; unlimited when None.
    """

    def __init__(
        self, velocity_max: Array, acceleration_max: Array, period_s: float = 0.01, jerk_max: Array | None = None
    ) -> None:
        import ruckig

        self._v_max, a_max = np.asarray(velocity_max, float), np.asarray(acceleration_max, float)
        n = len(self._v_max)
        if a_max.shape != (n,) or not (self._v_max > 0).all() or not (a_max > 0).all() or not period_s > 0:
            raise InvalidInput(
                f"limits must be {n} positive numbers, got {velocity_max}, {acceleration_max}, {period_s}"
            )
        self._ruckig: Any = ruckig.Ruckig(n, period_s)
        self._input: Any = ruckig.InputParameter(n)
        self._output: Any = ruckig.OutputParameter(n)
        self._input.control_interface = ruckig.ControlInterface.Velocity
        self._input.max_acceleration = a_max.tolist()
        self._input.max_jerk = (np.full(n, np.inf) if jerk_max is None else np.asarray(jerk_max, float)).tolist()
        self.reset()

    @property
    def velocity(self) -> Array:
        """The last set-point (n,)."""
        return np.array(self._input.current_velocity)

    def reset(self, velocity: Array | None = None) -> None:
        """Start again from a measured speed (n,), or from rest."""
        n = len(self._v_max)
        self._input.current_position = [0.0] * n
        self._input.current_velocity = [0.0] * n if velocity is None else np.asarray(velocity, float).tolist()
        self._input.current_acceleration = [0.0] * n

    def step(self, velocity: Array) -> Array:
        """The next set-point (n,) towards the wished `velocity`, which is scaled into the speed limits first.

        Raises:
            InvalidInput: the wish is not finite or has another shape.
        """
        wish = np.asarray(velocity, dtype=float)
        if wish.shape != self._v_max.shape or not np.isfinite(wish).all():
            raise InvalidInput(f"velocity must be {len(self._v_max)} finite numbers, got {velocity}")
        wish = wish / max(1.0, float((np.abs(wish) / self._v_max).max()))
        self._input.target_velocity = wish.tolist()
        self._input.target_acceleration = [0.0] * len(wish)
        self._ruckig.update(self._input, self._output)
        self._output.pass_to_input(self._input)
        return self.velocity

    def stop(self) -> Array:
        """The next set-point on the quickest way to rest."""
        return self.step(np.zeros_like(self._v_max))

    @property
    def at_rest(self) -> bool:
        """Whether the set-point is zero."""
        return bool(np.abs(self.velocity).max() < 1e-9)
