"""Randomness of a sensor that depends on the frame alone: who reads what, and when, shifts nothing."""

from __future__ import annotations

import zlib

import numpy as np

from grape.messages import Array

_BLOCK = 256


class FrameNoise:
    """Generators and noise of one sensor.

    Args:
        seed: of the whole simulation.
        name: of the sensor; each name has a stream of its own.
    """

    def __init__(self, seed: int, name: str) -> None:
        self._seed = seed
        self._stream = zlib.crc32(name.encode())
        self._block: tuple[tuple[int, int], Array] | None = None

    def constant(self) -> np.random.Generator:
        """A generator for what stays the same during a run (biases, scale errors); always starts afresh."""
        return self._generator(0)

    def frame(self, index: int) -> np.random.Generator:
        """A generator for frame `index`."""
        return self._generator(1, index)

    def normal(self, index: int, size: int) -> Array:
        """(size,) standard normal numbers for frame `index`, drawn in blocks: cheap for fast sensors."""
        key = (index // _BLOCK, size)
        if self._block is None or self._block[0] != key:
            self._block = key, self._generator(2, *key).standard_normal((_BLOCK, size))
        return self._block[1][index % _BLOCK]

    def _generator(self, *path: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(self._stream, *path)))


class SlowDrift:
    """A wandering error as a sum of slow sines with random phases: a function of time, so it needs no memory.

    Args:
        sigma: standard deviation of each component over long times.
        size: number of independent components.
        periods_s: shortest and longest period.
    """

    def __init__(
        self, rng: np.random.Generator, sigma: float, size: int, periods_s: tuple[float, float] = (40.0, 400.0)
    ) -> None:
        waves = 5
        self._amplitude = sigma * np.sqrt(2.0 / waves)
        log_low, log_high = np.log(periods_s)
        self._omega = 2 * np.pi / np.exp(rng.uniform(log_low, log_high, (size, waves)))
        self._phase = rng.uniform(0.0, 2 * np.pi, (size, waves))

    def at(self, time_s: float) -> Array:
        """(size,) error at a time."""
        return self._amplitude * np.sin(self._omega * time_s + self._phase).sum(axis=1)
