"""Row G3: worlds that a robot can drive in, what counts as found, and that an experiment goes on from what it has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grape.experiments import g3_mapping as g3
from grape.experiments.bench_navigation import amcl
from grape.experiments.laser_worlds import MAX_RANGE, Canvas, building, laser_scans, vineyard, way_of
from grape.localization import LikelihoodField
from grape.mapping import OccupancyGrid


@pytest.mark.parametrize("draw", [building, vineyard])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_way_is_free_and_a_seed_gives_one_world(draw: Any, seed: int) -> None:
    world, other = draw(seed), draw(seed + 50)
    way = way_of(world)
    places = way[:, None, :2] + 0.3 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    assert (world.grid.at(places) == 0).all()
    np.testing.assert_array_equal(world.grid.occupancy, draw(seed).grid.occupancy)
    assert world.grid.occupancy.shape != other.grid.occupancy.shape
    steps = np.hypot(*np.diff(way[:, :2], axis=0).T)
    assert steps.max() < 0.36 and len(way) > 100


def test_clutter_shortens_its_share_of_the_beams() -> None:
    world = building(1)
    way = way_of(world)[:20]
    clean = laser_scans(world.grid, way, np.random.default_rng(0))
    cluttered = laser_scans(world.grid, way, np.random.default_rng(0), clutter=0.2)
    off = np.array([a.ranges - b.ranges for a, b in zip(clean, cluttered, strict=True)])
    assert off.min() >= 0.0 and np.mean(off > 0.0) == pytest.approx(0.2, abs=0.03)
    assert min(scan.ranges.min() for scan in cluttered) >= 0.3 and max(s.ranges.max() for s in clean) < MAX_RANGE


def trial(*errors: float) -> g3.Trial:
    return g3.Trial(errors=errors, particles=(300,) * len(errors))


def test_found_is_to_be_near_until_the_end() -> None:
    near, far = (0.1,) * g3.LAST, (3.0,) * 4
    assert trial(*far, *near).found and trial(*far, *near).until_found() == 4
    assert trial(*far, *near).until_found(since=2) == 2
    assert trial(*near).until_found() == 0
    assert not trial(*near, *far).found and trial(*near, *far).until_found() is None


def test_a_map_that_is_moved_by_its_fit_has_no_error_and_a_thicker_wall_has() -> None:
    canvas, thick = Canvas(4.0, 3.0), Canvas(4.0, 3.0)
    canvas.box(1.0, 1.0, 3.0, 1.1)
    thick.box(1.0, 1.0, 3.0, 1.3)
    truth = canvas.grid()
    assert g3.map_errors(truth, truth, np.zeros(3)).max() == 0.0
    assert g3.map_errors(truth, truth, np.array([0.0, 0.5, 0.0])).min() > 0.3
    assert g3.map_errors(thick.grid(), truth, np.zeros(3)).max() == pytest.approx(0.2)


def test_who_is_carried_away_is_looked_for_where_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Odometry runs on without a jump, while scans and truth begin again."""
    calls: list[tuple[np.ndarray, int]] = []
    true = np.array([[0.5 * k, 0.0, 0.0] for k in range(8)])

    class Watched(g3.Amcl):
        def update(self, odometry: Any, scan: Any, rng: Any) -> Any:
            calls.append((odometry, scan))
            return g3.AmclEstimate(
                pose=true[scan],
                covariance=np.eye(3),
                share=1.0,
                particles=9,
                likelihood=1.0,
                strangers=0.0,
                updated=True,
            )

    monkeypatch.setattr(g3, "Amcl", Watched)
    scans: Any = list(range(8))
    shifted = true + np.array([5.0, 1.0, 0.0])
    found = g3.localised(_field(), "carried away", true, shifted, scans, np.random.default_rng(0))
    assert [scan for _, scan in calls] == [0, 1, 2, 3, 0, 1, 2, 3]
    steps = np.diff([pose[0] for pose, _ in calls])
    np.testing.assert_allclose(steps, [0.5, 0.5, 0.5, 0.0, 0.5, 0.5, 0.5], atol=1e-12)
    assert max(found.errors) == 0.0 and found.particles == (9,) * 8


def test_worlds_that_the_folder_has_are_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[str, int]] = []
    slam = {"way_m": 0.1, "odometry_m": 2.0, "map_m": [0.0, 0.05], "loops": 4, "lost": 0}

    def measure(name: str, seed: int, folder: Path) -> dict[str, Any]:
        calls.append((name, seed))
        scans = {"errors": [2.0] * 5 + [0.1] * 25, "particles": [300] * 30}
        return {kind: scans for kind in g3.TRIALS} | {"slam": slam}

    monkeypatch.setattr(g3, "measure", measure)
    monkeypatch.setattr(g3, "embedded", lambda picture: f"<svg>{picture.name}</svg>")
    g3.run([500], tmp_path, lambda share, text: None)
    proof = g3.run([500, 501], tmp_path, lambda share, text: None)
    assert calls == [(name, seed) for seed in (500, 501) for name in g3.WORLDS]
    values = {q.name: (q.value, q.n) for q in proof.quantities}
    assert values["building: AMCL, known start: error, root mean square"] == (pytest.approx(0.1), 20)
    assert values["vineyard: AMCL, anywhere: found at the end"] == (1.0, 2)
    assert values["vineyard: AMCL, anywhere: scans until found, median of those found"] == (5.0, 2)
    assert values["building: SLAM: error of the way, worst"] == (0.1, 2)
    assert [figure.svg for figure in proof.figures if "building_500" in figure.svg], "the first map is shown"
    assert json.loads((tmp_path / "building_500.json").read_text())["slam"] == slam


def test_both_sides_of_the_bench_weigh_particles_alike() -> None:
    world = building(1)
    field, rng = _field(), np.random.default_rng(0)
    way = way_of(world)[:1]
    scan = laser_scans(world.grid, way, rng)[0]
    poses = way[0] + rng.normal(0.0, [0.5, 0.5, 0.3], (200, 3))
    ours = amcl.Amcl(field, amcl.AmclOptions(beams=amcl.BEAMS))
    points = ours._beams(scan)
    np.testing.assert_allclose(ours._log_weights(poses, points), amcl.numpy_logs(field, poses, scan), atol=0.05)
    weights = np.full(200, 1.0 / 200)
    ours.poses, ours.weights = poses, weights
    mean, covariance, _ = ours._heaviest()
    mean_numpy, covariance_numpy = amcl.numpy_estimate(poses, weights, ours.options)
    assert np.hypot(*(mean - mean_numpy)[:2]) < 0.1
    np.testing.assert_allclose(np.diag(covariance), np.diag(covariance_numpy), rtol=0.3)


def _field() -> LikelihoodField:
    grid: OccupancyGrid = building(1).grid
    return LikelihoodField(grid)
