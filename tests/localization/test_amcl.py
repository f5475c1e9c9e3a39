"""Monte Carlo localisation in a building: it follows, finds itself, recovers and repeats itself."""

from __future__ import annotations

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from building import building, drifting, laser_scans, way_round

from grape.errors import InvalidInput
from grape.localization import Amcl, AmclEstimate, AmclOptions, LikelihoodField, OdometryNoise
from grape.localization.amcl_kernels import cos_sin, heaviest, kld_bound, log_weights, normals, resample
from grape.localization.motion import moved
from grape.mapping import OccupancyGrid
from grape.messages import Array
from grape.navigation.grid import GridSpec

START_COVARIANCE = np.diag([0.04, 0.04, 0.01])


@pytest.fixture(scope="module")
def field() -> LikelihoodField:
    return LikelihoodField(building(0.1))


@pytest.fixture(scope="module")
def drive() -> tuple[Array, Array, list]:
    rng = np.random.default_rng(7)
    true = way_round(0.35, 0.25)
    return true, drifting(true, rng), laser_scans(building(0.1), true, rng)


def off(estimate: AmclEstimate, true: Array) -> float:
    return float(np.hypot(*(estimate.pose[:2] - true[:2])))


def follow(amcl: Amcl, drive: tuple, rng: np.random.Generator) -> list[AmclEstimate]:
    _, odometry, scans = drive
    return [amcl.update(pose, scan, rng) for pose, scan in zip(odometry, scans, strict=True)]


def test_it_follows_where_odometry_drifts(field: LikelihoodField, drive: tuple) -> None:
    true, odometry, _ = drive
    amcl, rng = Amcl(field), np.random.default_rng(0)
    amcl.start(true[0], START_COVARIANCE, rng)
    estimates = follow(amcl, drive, rng)
    errors = [off(estimate, pose) for estimate, pose in zip(estimates, true, strict=True)]
    assert np.hypot(*(odometry[-1] - true[-1])[:2]) > 0.3, "the test would not need a filter"
    assert np.median(errors[5:]) < 0.10 and max(errors[5:]) < 0.30
    assert estimates[-1].share > 0.95
    assert estimates[-1].particles < 2000, "few particles are enough once it knows its place"


def test_it_finds_itself_anywhere(field: LikelihoodField, drive: tuple) -> None:
    true = drive[0]
    amcl, rng = Amcl(field), np.random.default_rng(3)
    amcl.start_anywhere(rng)
    estimates = follow(amcl, drive, rng)
    assert off(estimates[-1], true[-1]) < 0.2 and estimates[-1].share > 0.9


def test_it_recovers_after_it_was_carried_away(field: LikelihoodField, drive: tuple) -> None:
    """The first half is driven believing the wrong place, which is known for sure: only strangers can save it."""
    true, _, scans = drive
    amcl, rng = Amcl(field), np.random.default_rng(1)
    amcl.start(true[0], 1e-4 * np.eye(3), rng)
    for _ in range(3):
        for k in (0, 2, 4, 6):
            amcl.update(true[k], scans[k], rng)
    estimates = []
    shift = true[40]  # the robot is lifted from node 6 to node 40 and odometry knows nothing of it
    for k in range(40, len(true)):
        estimates.append(amcl.update(true[k] - shift + true[6], scans[k], rng))
    assert max(estimate.strangers for estimate in estimates) > 0.0
    assert off(estimates[-1], true[-1]) < 0.5


def test_one_search_in_vain_does_not_make_being_lost_what_is_usual(
    field: LikelihoodField, drive: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    amcl, rng = Amcl(field, AmclOptions(recovery_tries=5)), np.random.default_rng(0)
    amcl.start(drive[0][0], START_COVARIANCE, rng)
    amcl.update(np.zeros(3), drive[2][0], rng)
    usual, low = amcl._slow, 0.5 * amcl._slow
    fits = iter([low] * 4 + [0.95 * usual] + [low] * 5)
    monkeypatch.setattr(amcl, "_draw_strangers", lambda points, rng: (amcl.poses, next(fits)))
    amcl._fast = low
    taken = [amcl._recovery(low, np.zeros((1, 2)), rng)[0] for _ in range(9)]
    assert [share > 0.0 for share in taken] == [False] * 4 + [True] + [False] * 4
    assert amcl._slow > 0.9 * usual, "a find in between begins the count anew"
    amcl._recovery(low, np.zeros((1, 2)), rng)
    assert amcl._slow == amcl._fast < 0.6 * usual, "the place has changed"


def test_a_global_start_knows_what_fits_best_as_usual(field: LikelihoodField, drive: tuple) -> None:
    amcl, rng = Amcl(field), np.random.default_rng(0)
    amcl.start_anywhere(rng)
    first = amcl.update(np.zeros(3), drive[2][0], rng)
    assert first.strangers == 1.0
    assert amcl._slow > 1.5 * first.likelihood, "not what the evenly drawn particles fit"


def test_without_recovery_there_are_no_strangers(field: LikelihoodField, drive: tuple) -> None:
    amcl, rng = Amcl(field, AmclOptions(recovery_slow=0.0)), np.random.default_rng(0)
    amcl.start(np.array([8.0, 3.5, 0.0]), 1e-4 * np.eye(3), rng)
    assert all(estimate.strangers == 0.0 for estimate in follow(amcl, drive, rng))


def test_the_same_seed_gives_the_same_bytes(field: LikelihoodField, drive: tuple) -> None:
    def run(seed: int) -> bytes:
        amcl, rng = Amcl(field), np.random.default_rng(seed)
        amcl.start(drive[0][0], START_COVARIANCE, rng)
        return b"".join(estimate.pose.tobytes() for estimate in follow(amcl, drive, rng))

    assert run(5) == run(5) != run(6)


def test_a_small_step_moves_the_estimate_and_spares_the_scan(field: LikelihoodField, drive: tuple) -> None:
    true, _, scans = drive
    amcl, rng = Amcl(field), np.random.default_rng(0)
    amcl.start(true[0], START_COVARIANCE, rng)
    first = amcl.update(np.zeros(3), scans[0], rng)
    second = amcl.update(np.array([0.1, 0.0, 0.0]), scans[0], rng)
    assert first.updated and not second.updated
    assert np.hypot(*(second.pose - first.pose)[:2]) == pytest.approx(0.1)


def test_wrong_input_is_refused(field: LikelihoodField, drive: tuple) -> None:
    rng, scan = np.random.default_rng(0), drive[2][0]
    amcl = Amcl(field)
    with pytest.raises(InvalidInput, match="start"):
        amcl.update(np.zeros(3), scan, rng)
    with pytest.raises(InvalidInput, match="finite pose"):
        amcl.start(np.array([np.nan, 0, 0]), np.eye(3), rng)
    amcl.start(np.zeros(3), np.eye(3), rng)
    with pytest.raises(InvalidInput, match="odometry"):
        amcl.update(np.array([0, np.inf, 0]), scan, rng)
    with pytest.raises(InvalidInput, match="least <= most"):
        AmclOptions(least=10, most=5)
    empty = GridSpec(x_min=0, y_min=0, columns=3, rows=3)
    with pytest.raises(InvalidInput, match="occupied and free"):
        LikelihoodField(OccupancyGrid(spec=empty, occupancy=np.zeros((3, 3), np.int8)))


def test_weights_are_those_of_a_plain_loop(field: LikelihoodField) -> None:
    rng = np.random.default_rng(2)
    poses = rng.uniform([-1, -1, -3], [17, 11, 3], size=(20, 3))  # some outside the map
    points = rng.uniform(-6, 6, size=(15, 2))
    spec = field.spec
    ours = log_weights(field.bordered, spec.x_min, spec.y_min, spec.resolution, poses, points)
    for pose, ours_one in zip(poses, ours, strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        ends = points @ np.array([[c, s], [-s, c]]) + pose[:2]
        cells = spec.cells(ends)
        inside = spec.contains(cells)
        values = np.full(len(points), field.outside)
        values[inside] = field.log_likelihood[cells[inside][:, 0], cells[inside][:, 1]]
        assert ours_one == pytest.approx(values.mean(), abs=1e-5)


def test_cosines_and_sines_are_those_of_numpy() -> None:
    angles = np.r_[np.linspace(-20.0, 20.0, 10001), np.arange(-8, 9) * np.pi / 4]
    cosines, sines = cos_sin(angles)
    np.testing.assert_allclose(cosines, np.cos(angles), atol=1e-6)
    np.testing.assert_allclose(sines, np.sin(angles), atol=1e-6)


def test_errors_of_particles_are_normal_and_do_not_hang_together() -> None:
    n = 200_000
    numbers = normals(np.uint64(7), n).astype(float)
    assert (normals(np.uint64(7), n) == numbers).all() and (normals(np.uint64(8), n) != numbers).mean() > 0.99
    assert numbers.mean(axis=1) == pytest.approx(np.zeros(3), abs=4.0 / np.sqrt(n))
    assert numbers.std(axis=1) == pytest.approx(np.ones(3), abs=4.0 / np.sqrt(2 * n))
    levels = np.linspace(-3.0, 3.0, 25)
    share = (numbers[:, None, :] < levels[:, None]).mean(axis=2)
    assert np.abs(share - [NormalDist().cdf(level) for level in levels]).max() < 2.0 / np.sqrt(n)
    following, other_seed = np.roll(numbers, 1, axis=1), normals(np.uint64(8), n)
    together = np.corrcoef(np.vstack([numbers, following, other_seed])) - np.eye(9)
    assert np.abs(together).max() < 5.0 / np.sqrt(n)


def test_kld_asks_for_the_particles_of_the_paper() -> None:
    assert kld_bound(1, 0.05, 2.326) == 1.0
    assert kld_bound(2, 0.05, 2.326) == pytest.approx(10 * (1 - 2 / 9 + np.sqrt(2 / 9) * 2.326) ** 3)
    assert kld_bound(100, 0.05, 2.326) > kld_bound(10, 0.05, 2.326)


def test_resampling_follows_weights_and_stops_early_where_particles_are_close() -> None:
    rng = np.random.default_rng(0)
    poses = np.array([[0.0, 0, 0], [5.0, 0, 0]])
    size, nobody = np.array([0.25, 0.25, 0.2]), np.zeros((4000, 3))
    uniforms, never = rng.random(4000), np.zeros(0, bool)
    chosen = resample(poses, np.array([0.25, 0.75]), uniforms, nobody, never, size, 1000, 0.05, 2.3)
    assert len(chosen) == 1000, "two bins need few particles"
    assert (chosen == 1).mean() == pytest.approx(0.75, abs=0.05)
    spread = rng.uniform(-50, 50, (4000, 3))
    even = np.full(4000, 0.5)
    spread[:, 2] = rng.uniform(-np.pi, np.pi, 4000)
    assert len(resample(spread, even, uniforms, nobody, never, size, 10, 0.05, 2.3)) == 4000
    rest = np.r_[even[:3000], np.zeros(1000)]
    assert resample(spread, rest, uniforms, nobody, never, size, 10, 0.05, 2.3).max() < 3000, "none without weight"
    strange = rng.random(4000) < 0.3
    mixed = resample(poses, np.array([0.25, 0.75]), uniforms, spread, strange, size, 4000, 0.05, 2.3)
    assert (np.flatnonzero(mixed < 0) == np.flatnonzero(strange)).all()
    assert (mixed[strange] == -1 - np.flatnonzero(strange)).all(), "each stranger once"


def test_the_estimate_is_the_heaviest_cluster_also_across_pi() -> None:
    rng = np.random.default_rng(1)
    heavy = np.column_stack([rng.normal([3.0, -2.0], 0.1, (300, 2)), np.pi + rng.normal(0.0, 0.05, 300)])
    light = np.column_stack([rng.normal([9.0, 4.0], 0.1, (300, 2)), rng.normal(0.0, 0.05, 300)])
    poses = np.vstack([light, heavy])
    poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    weights = np.r_[np.full(300, 0.3), np.full(300, 0.7)] / 300
    mean, covariance, share = heaviest(poses, weights, np.array([1.0, 1.0, 0.5]))
    expected = heavy.mean(axis=0) - [0.0, 0.0, 2 * np.pi * (heavy[:, 2].mean() > np.pi)]
    np.testing.assert_allclose(mean, expected, atol=1e-9)
    np.testing.assert_allclose(covariance, np.cov(heavy.T, bias=True), atol=1e-9)
    assert share == pytest.approx(0.7)


def test_motion_without_noise_is_the_step_and_backwards_is_no_turn() -> None:
    still = OdometryNoise(turn_by_turn=0, turn_by_way=0, way_by_way=0, way_by_turn=0, least_way=0, least_turn=0)
    start = np.array([[1.0, 2.0, 0.5]])
    for step in ([0.3, 0.1, 0.2], [-0.3, 0.0, 0.0], [0.0, 0.0, 1.0]):
        c, s = np.cos(0.5), np.sin(0.5)
        expected = [1 + c * step[0] - s * step[1], 2 + s * step[0] + c * step[1], 0.5 + step[2]]
        ours = moved(start, np.array(step), still, np.random.default_rng(0))[0]
        assert ours == pytest.approx(expected)
    many = np.zeros((4000, 3))
    turning = OdometryNoise(turn_by_way=0.0, least_turn=0.0)
    back = moved(many, np.array([-1.0, 0.0, 0.0]), turning, np.random.default_rng(0))
    assert np.abs(np.abs(back[:, 1])).max() < 1e-6, "a straight way back has no turn to be wrong about"


def test_a_scan_of_weeds_alone_moves_nobody(field: LikelihoodField, drive: tuple) -> None:
    """Nothing on the map fits what is seen, so the robot is not looked for elsewhere."""
    true, _, scans = drive
    amcl, rng = Amcl(field), np.random.default_rng(4)
    amcl.start(true[0], START_COVARIANCE, rng)
    for k in range(12):
        amcl.update(true[k], scans[k], rng)
    weeds = [replace(scans[k], ranges=rng.uniform(0.3, 3.0, 181)) for k in range(12, 20)]
    estimates = [amcl.update(true[12 + k], scan, rng) for k, scan in enumerate(weeds)]
    assert min(estimate.likelihood for estimate in estimates) < 0.4
    assert all(estimate.strangers == 0.0 for estimate in estimates)
    assert off(estimates[-1], true[19]) < 1.5


def test_a_scan_without_a_return_is_not_used(field: LikelihoodField, drive: tuple) -> None:
    true, odometry, scans = drive
    amcl, rng = Amcl(field), np.random.default_rng(4)
    amcl.start(true[0], START_COVARIANCE, rng)
    blind = replace(scans[3], ranges=np.full(181, np.inf))
    assert amcl.update(odometry[0], scans[0], rng).updated and not amcl.update(odometry[3], blind, rng).updated


def test_a_start_anywhere_is_unsure_or_right_from_the_first_scan(field: LikelihoodField, drive: tuple) -> None:
    for seed in range(4):
        amcl, rng = Amcl(field), np.random.default_rng(seed)
        amcl.start_anywhere(rng)
        first = amcl.update(np.zeros(3), drive[2][0], rng)
        assert first.strangers == 1.0 and first.likelihood < 0.9
        assert first.share < 0.9 or off(first, drive[0][0]) < 0.3
