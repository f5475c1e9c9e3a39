"""From a bench to its table and its JSON."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from grape import cli, plugins
from grape.errors import InvalidInput
from grape.proof import Bench, Comparison


def measure(progress: Any) -> Sequence[Comparison]:
    progress(0.5, "measuring")
    return (
        Comparison(quantity="check", unit="µs", value=2.0, peer="theirs", peer_value=50.0, ratio_goal=">= 20"),
        Comparison(quantity="plan", unit="ms", value=4.0, peer="theirs", peer_value=8.0, ratio_goal=">= 8"),
        Comparison(quantity="cycle", unit="µs", value=90.0, value_goal="<= 100"),
        Comparison(quantity="shown", unit="ms", value=1.0),
        Comparison(quantity="grows", unit="ms", value=1.0, at=8),
        Comparison(quantity="grows", unit="ms", value=3.0, at=640),
    )


BENCH = Bench(name="speeds", summary="Measures nothing.", run=measure)


def bench(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """`grape bench ARGUMENTS` where `speeds` is installed; the exit code."""
    built_in = {**plugins.BUILT_IN, plugins.BENCHES: {"speeds": f"{__name__}:BENCH"}}
    monkeypatch.setattr(plugins, "BUILT_IN", built_in)
    monkeypatch.setitem(sys.modules, __name__, sys.modules[__name__])
    monkeypatch.setattr(sys, "argv", ["grape", "bench", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return int(end.value.code or 0)


def test_rows_have_the_schema_and_say_whether_goals_are_met(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench(monkeypatch, "speeds", "--json", str(tmp_path / "speeds.json")) == 0
    content = json.loads((tmp_path / "speeds.json").read_text())
    assert (content["schema"], content["name"]) == ("grape.bench/1", "speeds")
    check, plan, cycle, shown, *sizes = content["rows"]
    assert {key: check[key] for key in ("quantity", "value", "unit", "peer", "peer_value", "ratio")} == {
        "quantity": "check", "value": 2.0, "unit": "µs", "peer": "theirs", "peer_value": 50.0, "ratio": 25.0,
    }  # fmt: skip
    assert [row["met"] for row in (check, plan, cycle, shown)] == [True, False, True, None]
    assert (cycle["peer_value"], cycle["ratio"]) == (None, None)
    assert [row["at"] for row in sizes] == [8, 640] and shown["at"] is None
    assert "x25.0" in capsys.readouterr().out


def test_the_page_has_a_line_for_what_was_measured_at_several_sizes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert bench(monkeypatch, "speeds", "--html", str(tmp_path / "speeds.html")) == 0
    page = (tmp_path / "speeds.html").read_text()
    (drawing,) = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    ElementTree.fromstring(drawing)
    assert drawing.count("<polyline") == 1 and len(re.findall(r"[\d.]+,[\d.]+", drawing)) == 2
    assert "grows, at 640" in page and "x25.0" in page and "ratio &gt;= 8" in page


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["speed"], "did you mean 'speeds'?"),
        (["speeds", "--json", "gone/a.json"], "--json gone/a.json: its folder does not exist"),
        (["speeds", "--html", "gone/a.html"], "--html gone/a.html: its folder does not exist"),
    ],
)
def test_wrong_input_ends_with_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert bench(monkeypatch, *arguments) == 1
    assert expected in capsys.readouterr().err


def test_a_goal_of_a_comparison_must_have_a_bound() -> None:
    with pytest.raises(InvalidInput, match="a sign and a bound"):
        Comparison(quantity="check", unit="µs", value=1.0, ratio_goal="20 times")
