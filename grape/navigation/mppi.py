"""Model predictive path integral control: thousands of noisy control sequences, averaged by how well they do.

Source: Williams, Wagener, Goldfain, Drews, Rehg, Boots and Theodorou, Information theoretic MPC for model-based
reinforcement learning, ICRA 2017; which costs matter for a base on a path: the critics of Nav2's MPPI controller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.navigation.follower import PursuitOptions
from grape.navigation.tracking import Situation, TrackingPlanner, Wish


@dataclass(frozen=True, kw_only=True)
class MppiOptions:
    """Size of the search and what counts.

    Args:
        samples, steps, period: number of sequences, their length, s between their controls.
        v_sigma, w_sigma: m/s, rad/s of the noise on the controls.
        correlation: of the noise from one control to the next; white noise would mostly average out.
        temperature: cost at which a sequence counts 1/e of the best one.
        lateral: 1/m², cost of being off the path, from `loose` m on only linear, so that a detour is not forbidden;
            heading: of facing away from it; speed: s²/m², of another speed than
            wanted; progress: 1/m, of what is left of the path ahead at the end; steering: s²/rad², of change of yaw
            rate; near: of touching, falling to none at `margin` m from lethal cells; contact: of contact.
    """

    samples: int = 2000
    steps: int = 56
    period: float = 0.05
    v_sigma: float = 0.15
    w_sigma: float = 0.35
    correlation: float = 0.85
    temperature: float = 0.02
    lateral: float = 60.0
    loose: float = 0.03
    heading: float = 1.0
    speed: float = 1.0
    progress: float = 0.5
    steering: float = 0.05
    near: float = 1.5
    margin: float = 0.15
    contact: float = 100.0

    def __post_init__(self) -> None:
        if self.samples < 2 or self.steps < 2 or not self.period > 0 or not self.temperature > 0:
            raise InvalidInput(f"at least 2 samples and 2 steps, period and temperature > 0, got {self}")
        if not 0.0 <= self.correlation < 1.0:
            raise InvalidInput(f"correlation must lie in 0 .. 1, got {self.correlation}")


class Mppi(TrackingPlanner):
    """Samples control sequences around the last one; the noise is drawn once and used from another row every time.

    Args:
        motion: limits of the base, and how it turns and settles.
        options: of the search.
        rng: draws the noise.
    """

    def __init__(
        self,
        motion: PursuitOptions | None = None,
        options: MppiOptions | None = None,
        *,
        rng: np.random.Generator | None = None,
    ) -> None:
        super().__init__(motion)
        self.search_options = options or MppiOptions()
        self._noise = _coloured(self.search_options, rng or np.random.default_rng(0))

    def search(self, situation: Situation, memory: Array | None, steps: int) -> Wish:
        """See `TrackingPlanner.search`; the memory is the mean sequence (steps, 2)."""
        from grape.navigation.mppi_kernels import Prices, average, rollouts

        o, motion = self.search_options, self.options
        plan = self._shifted(memory, situation)
        limits = np.array(
            [
                -motion.reverse_speed,
                motion.speed,
                motion.turn_speed,
                motion.acceleration * o.period,
                2.0 * motion.deceleration * o.period,
                motion.turn_acceleration * o.period,
            ]
        )
        prices = Prices(*(getattr(o, name) for name in Prices._fields))
        first = (steps * 7919) % self._noise.shape[2]
        costs, controls = rollouts(
            self._noise,
            first,
            o.samples,
            plan,
            situation.pose,
            situation.velocity,
            limits,
            prices,
            situation.ahead,
            situation.field,
            situation.frame,
            situation.discs,
        )
        mean, best = average(costs, controls, o.temperature)
        beat = min(len(mean) - 1, max(1, round(situation.dt / o.period)) - 1)
        return Wish(v=float(mean[beat, 0]), w=float(mean[beat, 1]), memory=mean, blocked=bool(best >= o.contact))

    def _shifted(self, memory: Array | None, situation: Situation) -> Array:
        """The last mean sequence, as much later as time went on; at first the present velocity."""
        steps = self.search_options.steps
        if memory is None or memory.shape != (steps, 2):
            return np.tile(situation.velocity, (steps, 1))
        shift = min(steps - 1, max(1, round(situation.dt / self.search_options.period)))
        return np.concatenate([memory[shift:], np.repeat(memory[-1:], shift, axis=0)])


def _coloured(options: MppiOptions, rng: np.random.Generator) -> Array:
    """(2, steps, 2 samples) float32 noise on v (m/s) and w (rad/s), each step correlated with the one before."""
    white = rng.standard_normal((2 * options.samples, options.steps, 2)).astype(np.float32)
    a = np.float32(options.correlation)
    b = np.float32(np.sqrt(1.0 - a * a))
    for k in range(1, options.steps):
        white[:, k] = a * white[:, k - 1] + b * white[:, k]
    return np.ascontiguousarray((white * np.array([options.v_sigma, options.w_sigma], dtype=np.float32)).T)
