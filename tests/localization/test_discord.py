"""Two estimates that part are told apart: once is suspect, again and again is discord, and neither is fused."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.localization import (
    Accord,
    AmclEstimate,
    DiscordOptions,
    DiscordWatch,
    PlanarBelief,
    belief_of,
    from_amcl,
)

SMALL = np.diag([0.01, 0.01, 0.001]) * 0.1


def belief(x: float, yaw: float = 0.0, covariance: np.ndarray = SMALL) -> PlanarBelief:
    return PlanarBelief(pose=np.array([x, 0.0, yaw]), covariance=covariance)


def estimate(x: float, updated: bool = True) -> AmclEstimate:
    return AmclEstimate(
        pose=np.array([x, 0.0, 0.0]), covariance=SMALL, share=1.0, particles=500, likelihood=0.8, strangers=0.0,
        updated=updated,
    )  # fmt: skip


def test_estimates_within_their_errors_agree() -> None:
    answer = DiscordWatch().compare(belief(0.0), belief(0.2))
    assert answer.accord is Accord.AGREE
    assert answer.distance == pytest.approx(0.2)
    variance = 2 * (0.001 + 0.01)
    assert answer.chi_square == pytest.approx(0.2**2 / variance)


def test_a_row_apart_is_suspect_then_discord_and_ends_only_after_patience() -> None:
    watch = DiscordWatch(DiscordOptions(patience=3))
    row = [watch.compare(belief(0.0), belief(2.6)).accord for _ in range(4)]
    assert row == [Accord.SUSPECT, Accord.SUSPECT, Accord.DISCORD, Accord.DISCORD]
    back = [watch.compare(belief(0.0), belief(0.0)).accord for _ in range(4)]
    assert back == [Accord.SUSPECT, Accord.SUSPECT, Accord.AGREE, Accord.AGREE]


def test_one_outlier_does_not_make_discord() -> None:
    watch = DiscordWatch()
    row = [watch.compare(belief(0.0), belief(x)).accord for x in (0.0, 2.6, 0.0, 2.6, 0.0)]
    assert row == [Accord.AGREE, Accord.SUSPECT, Accord.AGREE, Accord.SUSPECT, Accord.AGREE]


def test_headings_count_the_short_way_round() -> None:
    assert DiscordWatch().compare(belief(0.0, np.pi - 0.01), belief(0.0, -np.pi + 0.01)).accord is Accord.AGREE
    assert DiscordWatch().compare(belief(0.0, 0.0), belief(0.0, 1.0)).accord is Accord.SUSPECT


def test_who_does_not_know_says_nothing() -> None:
    watch = DiscordWatch()
    assert watch.compare(belief(0.0, covariance=4.0 * np.eye(3)), belief(9.0)).accord is Accord.UNSURE
    assert watch.compare(belief(0.0), belief(9.0), share=0.5).accord is Accord.UNSURE


def test_only_fresh_estimates_that_agree_become_measurements() -> None:
    watch = DiscordWatch()
    near, far = estimate(0.05), estimate(2.6)
    measurement = from_amcl(1.0, near, watch.compare(belief(0.0), belief_of(near)))
    assert measurement is not None
    assert measurement.index.tolist() == [0, 1, 5] and measurement.value.tolist() == [0.05, 0.0, 0.0]
    assert measurement.covariance[0, 0] == pytest.approx(0.001 + 0.05**2)
    assert from_amcl(1.0, far, watch.compare(belief(0.0), belief_of(far))) is None
    again = DiscordWatch().compare(belief(0.0), belief_of(near))
    assert from_amcl(1.0, estimate(0.05, updated=False), again) is None


def test_wrong_input_is_refused() -> None:
    with pytest.raises(InvalidInput, match="finite"):
        belief(float("nan"))
    with pytest.raises(InvalidInput, match="needed"):
        PlanarBelief(pose=np.zeros(2), covariance=SMALL)
    with pytest.raises(InvalidInput, match="patience"):
        DiscordOptions(patience=0)
