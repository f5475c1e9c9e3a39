"""Adaptive Monte Carlo localisation: where a robot is on a known map, by its laser and its odometry.

Source: Thrun, Burgard and Fox, Probabilistic Robotics, 2005, tables 8.3 (augmented recovery) and 8.4 (KLD
sampling); Lenser and Veloso, Sensor resetting localization, ICRA 2000 (new particles where the scan fits).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import wrap_angle
from grape.localization.likelihood_field import LikelihoodField
from grape.localization.motion import OdometryNoise, moved
from grape.mapping.planar import between, compose
from grape.mapping.scans import scan_ends
from grape.messages import Array, LaserScan, frozen_array

MILD = 0.3  # of the weight by which places to climb from are chosen
CLIMBS = np.geomspace(1.0, 0.1, 10)[:, None] * np.array([0.2, 0.2, 0.08])  # m, m, rad: spread of each try


@dataclass(frozen=True, kw_only=True)
class AmclOptions:
    """Options of `Amcl`; lengths in m, angles in rad.

    Particles are weighed after `update_way` or `update_turn` with `beams` beams shorter than `max_range`. Their
    log-likelihoods are summed as if only `effective_beams` were independent. `kld_error` and `kld_quantile` (of the
    normal distribution) set how many particles are kept, between `least` and `most`. While the likelihood's average
    of the last 1 / `recovery_fast` updates is below `recovery_below` of that of the last 1 / `recovery_slow`,
    particles are drawn anywhere, where the scan fits, and the slow average is `recovery_patience` as quick, so that
    being lost does not become what is usual. It ends when `recovery_tries` scans in a row fit nowhere `recovery_better`
    times as well: then the place has changed. A scan that fits nowhere as well as is usual says little, and moves
    nobody. After a global start, what is usual is first what fits best anywhere. A rate of 0 turns recovery off.
    """

    least: int = 300
    most: int = 2000
    anywhere: int = 20000  # poses tried in a global start or a recovery
    beams: int = 60
    max_range: float = 25.0
    effective_beams: float = 15.0
    update_way: float = 0.2
    update_turn: float = 0.2
    kld_error: float = 0.05
    kld_quantile: float = 2.326
    bin_way: float = 0.25
    bin_turn: float = 0.175
    recovery_slow: float = 0.02
    recovery_fast: float = 0.2
    recovery_below: float = 0.9
    recovery_patience: float = 0.1
    recovery_better: float = 1.1
    recovery_tries: int = 20
    cluster_way: float = 1.0  # around the heaviest place: what the estimate is made of
    cluster_turn: float = 0.5
    noise: OdometryNoise = field(default_factory=OdometryNoise)

    def __post_init__(self) -> None:
        if not 1 <= self.least <= self.most or self.anywhere < 1 or self.beams < 1:
            raise InvalidInput(f"1 <= least <= most, and at least one particle and beam needed, got {self}")


@dataclass(frozen=True, kw_only=True)
class AmclEstimate:
    """Where the robot is, after a call of `Amcl.update`.

    Args:
        pose: (3,) x y yaw in map, mean of the heaviest cluster.
        covariance: (3, 3) of that cluster.
        share: 0..1, weight of that cluster; far below 1 the place is ambiguous.
        particles: how many there are.
        likelihood: geometric mean of the beams' likelihoods where the filter believes to be after this update, 0..1.
        strangers: share of particles that were drawn anywhere at this update.
        updated: whether the scan was used; else odometry alone moved the estimate.
    """

    pose: Array
    covariance: Array
    share: float
    particles: int
    likelihood: float
    strangers: float
    updated: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen_array(self.pose, float))
        object.__setattr__(self, "covariance", frozen_array(self.covariance, float))


class Amcl:
    """A particle filter on one map. Chance comes from the generators handed in alone, so a run repeats.

    Args:
        field: likelihood field of the map.
        mount: (3,) x y yaw of the laser on the robot.
    """

    def __init__(self, field: LikelihoodField, options: AmclOptions | None = None, mount: Array | None = None) -> None:
        self.field = field
        self.options = options or AmclOptions()
        self.mount = mount
        self.poses = np.zeros((0, 3))
        self.weights = np.zeros(0)
        self._odometry: Array | None = None
        self._estimate: AmclEstimate | None = None
        self._slow = self._fast = 0.0
        self._vain = 0  # searches in a row that have found nothing better
        self._everywhere = False

    def start(self, pose: Array, covariance: Array, rng: np.random.Generator) -> None:
        """Begin around a pose (3,) with covariance (3, 3).

        Raises:
            InvalidInput: they are not finite or of another shape.
        """
        pose, covariance = np.asarray(pose, float), np.asarray(covariance, float)
        if pose.shape != (3,) or covariance.shape != (3, 3) or not np.isfinite([*pose, *covariance.ravel()]).all():
            raise InvalidInput(f"a finite pose (3,) and covariance (3, 3) needed, got {pose.shape}, {covariance.shape}")
        self._begin(rng.multivariate_normal(pose, covariance, size=self.options.most, method="eigh"))

    def start_anywhere(self, rng: np.random.Generator) -> None:
        """Begin all over the free cells; the first scan draws particles where it fits."""
        self._begin(self.field.free_poses(self.options.most, rng))
        self._everywhere = True

    def update(self, odometry: Array, scan: LaserScan, rng: np.random.Generator) -> AmclEstimate:
        """Take odometry (3,) x y yaw (any origin) and a scan of the same time.

        Raises:
            InvalidInput: not started, or odometry that is not finite.
        """
        odometry = np.array(odometry, float)
        if not len(self.poses):
            raise InvalidInput("call start or start_anywhere first")
        if odometry.shape != (3,) or not np.isfinite(odometry).all():
            raise InvalidInput(f"odometry must be a finite (3,), got {odometry}")
        if self._odometry is not None:
            step = between(self._odometry, odometry)
            small = np.hypot(step[0], step[1]) < self.options.update_way and abs(step[2]) < self.options.update_turn
            if small and self._estimate is not None:
                return self._carried(step)
            self.poses = moved(self.poses, step, self.options.noise, rng)
        self._odometry = odometry
        self._estimate = self._weigh(scan, rng)
        return self._estimate

    def _begin(self, poses: Array) -> None:
        poses[:, 2] = wrap_angle(poses[:, 2])
        self.poses, self.weights = poses, np.full(len(poses), 1.0 / len(poses))
        self._odometry, self._estimate, self._slow, self._fast, self._vain = None, None, 0.0, 0.0, 0
        self._everywhere = False

    def _carried(self, step: Array) -> AmclEstimate:
        last = self._estimate
        assert last is not None
        return AmclEstimate(
            pose=compose(last.pose, step),
            covariance=last.covariance,
            share=last.share,
            particles=last.particles,
            likelihood=last.likelihood,
            strangers=0.0,
            updated=False,
        )

    def _weigh(self, scan: LaserScan, rng: np.random.Generator) -> AmclEstimate:
        points, likelihood = self._beams(scan), 0.0
        if len(points):
            logs = self._log_weights(self.poses, points)
            weights = self.weights * self._raised(logs, len(points))
            self.weights = weights / weights.sum()
            likelihood = float(np.exp(logs) @ self.weights)
        pose, covariance, share = self._heaviest()
        strangers = 0.0
        if len(points):
            strangers, others = self._recovery(likelihood, points, rng)
            self._resample(strangers, others, rng)
        if strangers == 1.0:
            pose, covariance, share = self._heaviest()
        return AmclEstimate(
            pose=pose,
            covariance=covariance,
            share=share,
            particles=len(self.poses),
            likelihood=likelihood,
            strangers=strangers,
            updated=len(points) > 0,
        )

    def _log_weights(self, poses: Array, points: Array) -> Array:
        from grape.localization.amcl_kernels import log_weights

        spec, field = self.field.spec, self.field
        return log_weights(field.bordered, spec.x_min, spec.y_min, spec.resolution, np.ascontiguousarray(poses), points)

    def _raised(self, logs: Array, beams: int) -> Array:
        """Likelihoods of scans, up to a factor, from mean log-likelihoods of their beams."""
        raised = min(self.options.effective_beams, beams) * logs
        return np.exp(raised - raised.max())

    def _beams(self, scan: LaserScan) -> Array:
        """Points (m, 2) in the robot's frame of `beams` beams, evenly chosen among those with a return."""
        return np.ascontiguousarray(scan_ends(scan, self.options.max_range, self.mount, self.options.beams))

    def _strangers(self, likelihood: float) -> float:
        """Share of particles to draw anywhere, by the likelihood's slow and fast averages."""
        options = self.options
        if self._everywhere:
            self._everywhere = False
            return 1.0
        if options.recovery_slow <= 0.0 or options.recovery_fast <= 0.0:
            return 0.0
        if self._slow == 0.0:
            self._slow = self._fast = likelihood
        self._fast += options.recovery_fast * (likelihood - self._fast)
        ratio = self._fast / max(self._slow * options.recovery_below, 1e-12)
        patience = 1.0 if ratio >= 1.0 else options.recovery_patience
        self._slow += patience * options.recovery_slow * (likelihood - self._slow)
        return float(np.clip(1.0 - ratio, 0.0, 0.5))

    def _recovery(self, likelihood: float, points: Array, rng: np.random.Generator) -> tuple[float, Array]:
        """Share of particles to draw anywhere, and poses (most, 3) to take, or (0, 3)."""
        nobody = np.zeros((0, 3))
        strangers = self._strangers(likelihood)
        if strangers == 0.0:
            return 0.0, nobody
        others, fit = self._draw_strangers(points, rng)
        if strangers == 1.0:
            self._slow = self._fast = fit
            return strangers, others
        if fit < self.options.recovery_better * likelihood:
            self._vain += 1
            if self._vain >= self.options.recovery_tries:
                self._slow, self._vain = self._fast, 0
            return 0.0, nobody
        self._vain = 0
        return (strangers, others) if fit >= self.options.recovery_below * self._slow else (0.0, nobody)

    def _draw_strangers(self, points: Array, rng: np.random.Generator) -> tuple[Array, float]:
        """Poses (most, 3) from anywhere that fit the scan, and their mean likelihood.

        1. Draw evenly, and keep a part by a mild weight, so that many places stay. 2. Let each climb by itself. 3. Draw
        by the full weight.
        """
        poses = self.field.free_poses(self.options.anywhere, rng)
        logs = self._log_weights(poses, points)
        kept = self._drawn(MILD * logs, len(points), rng)
        poses, logs = poses[kept], logs[kept]
        for spread in CLIMBS:
            tried = poses + spread * rng.standard_normal(poses.shape)
            found = self._log_weights(tried, points)
            better = found > logs
            poses[better], logs[better] = tried[better], found[better]
        kept = self._drawn(logs, len(points), rng)
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses[kept], float(np.exp(logs[kept]).mean())

    def _drawn(self, logs: Array, beams: int, rng: np.random.Generator) -> Array:
        """Indices (most,) drawn by mean log-likelihoods (n,) of beams."""
        total = np.cumsum(self._raised(logs, beams))
        return np.minimum(np.searchsorted(total / total[-1], rng.random(self.options.most)), len(logs) - 1)

    def _resample(self, strangers: float, others: Array, rng: np.random.Generator) -> None:
        from grape.localization.amcl_kernels import resample

        options = self.options
        strange = rng.random(options.most) < strangers if strangers > 0.0 else np.zeros(0, bool)
        size = np.array([options.bin_way, options.bin_way, options.bin_turn])
        chosen = resample(
            self.poses, self.weights, rng.random(options.most), others, strange, size,
            options.least, options.kld_error, options.kld_quantile,
        )  # fmt: skip
        kept = self.poses.take(np.maximum(chosen, 0), axis=0)
        if strangers > 0.0:
            kept = np.where((chosen < 0)[:, None], others[np.maximum(-1 - chosen, 0)], kept)
        self.poses = kept
        self.weights = np.full(len(chosen), 1.0 / len(chosen))

    def _heaviest(self) -> tuple[Array, Array, float]:
        from grape.localization.amcl_kernels import heaviest

        options = self.options
        reach = np.array([options.cluster_way, options.cluster_way, options.cluster_turn])
        mean, covariance, share = heaviest(self.poses, self.weights, reach)
        return mean, covariance, float(share)
