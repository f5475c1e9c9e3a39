import pytest

from grape.errors import InvalidInput
from grape.proof import Quantity, parse_seeds, wilson95


def quantity(value: float | None, goal: str) -> Quantity:
    return Quantity(name="error", unit="m", value=value, n=10, goal=goal)


@pytest.mark.parametrize(("value", "goal", "met"), [(0.1, "<= 0.1", True), (0.1, "< 0.1", False), (3, ">= 2", True)])
def test_a_quantity_knows_whether_its_goal_is_met(value: float, goal: str, met: bool) -> None:
    assert quantity(value, goal).met is met


def test_a_quantity_without_a_value_does_not_meet_its_goal_and_one_without_a_goal_is_not_judged() -> None:
    assert quantity(None, "<= 0.1").met is False
    assert quantity(0.1, "").met is None


def test_a_goal_without_a_bound_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"<= 0\.10"):
        quantity(0.1, "small")


@pytest.mark.parametrize("text", ["9" * 5000 + ":1", "0:" + "9" * 5000, "0:999999999999", "\N{SUPERSCRIPT TWO}:3"])
def test_seeds_without_measure_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match="seeds"):
        parse_seeds(text)


def test_wilson_intervals_agree_with_published_values() -> None:
    assert wilson95(21, 24) == pytest.approx((0.690, 0.957), abs=0.001)
    assert wilson95(0, 0) == (0.0, 1.0)
    with pytest.raises(InvalidInput):
        wilson95(3, 2)
