"""How long one update of Monte Carlo localisation takes, beside the same steps in NumPy."""

from __future__ import annotations

import numpy as np

from grape.experiments.bench_manipulation import BenchError, seconds
from grape.experiments.laser_worlds import MAX_RANGE, building, drifting, laser_scans, way_of
from grape.geometry import wrap_angle
from grape.localization import Amcl, AmclOptions, LikelihoodField, OdometryNoise
from grape.localization.amcl_kernels import kld_bound
from grape.mapping import between, compose
from grape.messages import Array, LaserScan
from grape.proof import Comparison

PARTICLES, BEAMS, UPDATES = 2000, 60, 20
AGREEMENT_M = 0.05
START_STD = np.array([0.2, 0.2, 0.1])
Drive = tuple[Array, list[LaserScan]]  # odometry (n, 3) and scans


def rows() -> list[Comparison]:
    """Motion, weights, estimate and resampling of 2,000 particles by 60 beams in a building.

    Raises:
        BenchError: the two do not follow the robot to the same place.
    """
    rng = np.random.default_rng(1)
    world = building(1)
    true = way_of(world)[: UPDATES + 1]
    field, drive = LikelihoodField(world.grid), (drifting(true, rng), laser_scans(world.grid, true, rng))
    ours, theirs = ours_run(field, true[0], drive), numpy_run(field, true[0], drive)
    for name, pose in (("ours", ours), ("NumPy's", theirs)):
        off = float(np.hypot(*(pose - true[-1])[:2]))
        if not off < AGREEMENT_M:
            raise BenchError(f"{name} filter ends {off:.3f} m from the robot")
    times = seconds(lambda: ours_run(field, true[0], drive), lambda: numpy_run(field, true[0], drive))
    ms = [1e3 * least / (UPDATES + 1) for least in times]
    return [
        Comparison(
            quantity=f"AMCL: update, {PARTICLES:,} particles, {BEAMS} beams", unit="ms", value=ms[0],
            peer="the same in NumPy", peer_value=ms[1], ratio_goal=">= 5", value_goal="<= 0.6",
        )
    ]  # fmt: skip


def ours_run(field: LikelihoodField, start: Array, drive: Drive) -> Array:
    """(3,) the last estimate of `Amcl`, which keeps all its particles."""
    rng = np.random.default_rng(2)
    options = AmclOptions(least=PARTICLES, most=PARTICLES, beams=BEAMS, max_range=MAX_RANGE, recovery_slow=0.0)
    amcl = Amcl(field, options)
    amcl.start(start, np.diag(START_STD**2), rng)
    for odometry, scan in zip(*drive, strict=True):
        estimate = amcl.update(odometry, scan, rng)
    return estimate.pose


def numpy_run(field: LikelihoodField, start: Array, drive: Drive) -> Array:
    """(3,) the last estimate of a filter that does the same on whole arrays."""
    rng, options, last = np.random.default_rng(2), AmclOptions(), drive[0][0]
    poses = start + START_STD * rng.standard_normal((PARTICLES, 3))
    for odometry, scan in zip(*drive, strict=True):
        poses = numpy_motion(poses, between(last, odometry), options.noise, rng) if odometry is not last else poses
        logs = options.effective_beams * numpy_logs(field, poses, scan)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        estimate, _ = numpy_estimate(poses, weights, options)
        poses = poses[np.searchsorted(np.cumsum(weights), rng.random(PARTICLES)).clip(0, PARTICLES - 1)]
        bins = len(np.unique(numpy_bins(poses, options.bin_way, options.bin_turn)))
        if kld_bound(bins, options.kld_error, options.kld_quantile) > PARTICLES:
            raise BenchError(f"{bins} bins ask for more than {PARTICLES} particles")
        last = odometry
    return estimate


def numpy_bins(poses: Array, way: float, turn: float) -> Array:
    """(n,) numbers of the bins that poses lie in."""
    x, y, yaw = np.floor(poses / [way, way, turn]).astype(np.int64).T
    return np.asarray((x * 100_000 + y) * 1000 + yaw)


def numpy_estimate(poses: Array, weights: Array, options: AmclOptions) -> tuple[Array, Array]:
    """Mean (3,) and covariance (3, 3) of the particles around the heaviest bin."""
    inverse = np.unique(numpy_bins(poses, options.cluster_way, options.cluster_turn), return_inverse=True)[1]
    mean = poses[np.argmax(inverse == np.bincount(inverse, weights).argmax())]
    for _ in range(3):
        off = poses - mean
        off[:, 2] = wrap_angle(off[:, 2])
        near = (np.hypot(off[:, 0], off[:, 1]) < options.cluster_way) & (np.abs(off[:, 2]) < options.cluster_turn)
        share = weights * near / (weights @ near)
        shift = share @ off
        mean = mean + shift
    return mean, (off * share[:, None]).T @ off - np.outer(shift, shift)


def numpy_motion(poses: Array, step: Array, noise: OdometryNoise, rng: np.random.Generator) -> Array:
    """Poses (n, 3) after a step (3,) of odometry with errors of the same size."""
    way, turn = np.hypot(step[0], step[1]), abs(step[2])
    along = np.sqrt(noise.way_by_way * way**2 + noise.way_by_turn * turn**2) + noise.least_way
    around = np.sqrt(noise.turn_by_turn * turn**2 + noise.turn_by_way * way**2) + noise.least_turn
    std = np.array([along, 0.5 * along, around])
    return compose(poses, step + std * rng.standard_normal(poses.shape))


def numpy_logs(field: LikelihoodField, poses: Array, scan: LaserScan) -> Array:
    """Mean log-likelihoods (n,) of 60 beams of a scan."""
    angles = scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
    seen = np.flatnonzero(scan.ranges < MAX_RANGE)
    seen = seen[np.arange(BEAMS) * (len(seen) - 1) // (BEAMS - 1)]
    x, y = scan.ranges[seen] * np.cos(angles[seen]), scan.ranges[seen] * np.sin(angles[seen])
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    spec, bordered = field.spec, field.bordered
    column = ((poses[:, :1] + c * x - s * y - spec.x_min) / spec.resolution + 1.0).astype(np.int64)
    row = ((poses[:, 1:2] + s * x + c * y - spec.y_min) / spec.resolution + 1.0).astype(np.int64)
    inside = row.clip(0, spec.rows + 1), column.clip(0, spec.columns + 1)
    return np.asarray(bordered[inside].mean(axis=1))
