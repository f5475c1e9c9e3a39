"""The bench finds what is timed, and the filter's peer does the same as the filter."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from grape.experiments import bench_navigation
from grape.experiments.bench_manipulation import BenchError
from grape.experiments.bench_navigation import filter as filter_bench
from grape.localization import Ekf, EkfOptions, Measurement
from grape.proof import Comparison


def test_each_file_of_the_folder_is_timed_in_the_order_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    files = {path.stem for path in Path(bench_navigation.__file__).parent.glob("*.py")} - {"__init__"}
    assert set(bench_navigation.modules()) == files and "filter" in files
    monkeypatch.setattr(bench_navigation, "modules", lambda: ["a", "b"])
    for name, value in (("a", 1.0), ("b", 2.0)):
        module = ModuleType(name)
        module.rows = lambda name=name, value=value: [Comparison(quantity=name, unit="µs", value=value)]  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, f"{bench_navigation.__name__}.{name}", module)
    said: list[tuple[float, str]] = []
    found = bench_navigation.BENCH.run(lambda share, what: said.append((share, what)))
    assert [row.quantity for row in found] == ["a", "b"] and said == [(0.0, "a"), (0.5, "b")]


def test_the_motion_that_the_peer_is_given_is_that_of_the_filter() -> None:
    """Without measurements that say anything, both must come to the same place."""
    x = np.random.default_rng(3).normal(0.0, 0.3, 15)
    mean, covariance = x, np.eye(15) * 0.01
    nothing = np.zeros(15)
    ekf = Ekf(0.0, mean, covariance, EkfOptions(noise=nothing, motion_noise=nothing, turn_noise=nothing))
    for _ in range(20):
        F, mean = filter_bench._motion(mean, 0.02)
        covariance = F @ covariance @ F.T
        belief = ekf.predict_to(ekf.belief.stamp + 0.02)
    np.testing.assert_allclose(belief.mean, mean, atol=1e-9)
    np.testing.assert_allclose(belief.covariance, covariance, atol=1e-9)


def test_filterpy_comes_to_the_same_estimate_and_a_difference_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("filterpy")
    monkeypatch.setattr(filter_bench, "STEPS", 10)
    whole, alone = filter_bench.rows()
    assert (whole.ratio_goal, alone.ratio_goal) == (">= 5", "") and whole.value == alone.value
    monkeypatch.setattr(filter_bench, "ours_run", lambda measurements: np.ones(15))
    with pytest.raises(BenchError, match="differ"):
        filter_bench.rows()


def test_without_filterpy_the_filter_is_timed_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filter_bench, "STEPS", 10)
    monkeypatch.setattr(filter_bench, "find_spec", lambda name: None)
    (row,) = filter_bench.rows()
    assert row.peer == "" and row.value > 0.0
    values = np.full((1, 6), 0.01)
    measurement = Measurement(
        stamp=0.02, source="imu", index=filter_bench.INDEX, value=values[0], covariance=np.eye(6) * 0.0004
    )
    assert filter_bench.ours_run([measurement])[6] == pytest.approx(0.5)
