"""Errors say what was got, what is allowed and what may have been meant."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from grape.errors import InvalidInput, with_suggestion
from grape.localization.state import components
from grape.mapping.carmen import parse_carmen
from grape.perception.markers import MarkerDetector


def test_what_is_close_is_suggested_and_nothing_else() -> None:
    assert with_suggestion("no pose 'travl'", "travl", ["home", "travel"]) == "no pose 'travl'; did you mean 'travel'?"
    assert with_suggestion("no pose 'x'", "x", ["home", "travel"]) == "no pose 'x'"


@pytest.mark.parametrize(
    ("wrong", "end"),
    [
        (lambda: components("velocity"), "az"),
        (lambda: components("rol"), "; did you mean 'roll'?"),
        (lambda: parse_carmen([], "log", laser="sonar"), "RAWLASER5"),
        (lambda: parse_carmen([], "log", laser="RLASR"), "; did you mean 'RLASER'?"),
        (lambda: MarkerDetector("qr"), "ARUCO_ORIGINAL"),
        (lambda: MarkerDetector("4x4_5O"), "; did you mean '4X4_50'?"),
    ],
)
def test_messages_end_with_what_is_allowed_or_a_suggestion(wrong: Callable[[], object], end: str) -> None:
    with pytest.raises(InvalidInput) as error:
        wrong()
    assert str(error.value).endswith(end)
