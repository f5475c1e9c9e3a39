"""From a row to its table, its JSON and its page."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from grape import cli, plugins
from grape.errors import InvalidInput
from grape.proof import Experiment, Figure, Proof, Quantity, parse_seeds

Command = Callable[..., tuple[int, str, str]]


def measure(seeds: Any, folder: Path, progress: Any) -> Proof:
    """Counts seeds, and goes on from the count it finds."""
    progress(0.5, "half of it")
    path = folder / "count.txt"
    before = int(path.read_text()) if path.exists() else 0
    path.write_text(str(before + len(seeds)))
    return Proof(
        quantities=(
            Quantity(name="counted", unit="1", value=before + len(seeds), n=len(seeds), goal=">= 10"),
            Quantity(name="error", unit="mm", value=1.5, n=3, ci95=(1.0, 2.0), reference="2 <b>", goal="<= 2"),
            Quantity(name="unknown", unit="m", value=float("nan"), n=0),
        ),
        figures=(Figure(title="A line", svg='<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0"/></svg>'),),
        notes=("Counted by hand.",),
    )


EXPERIMENT = Experiment(row="X8", summary="Counts seeds.", seeds=range(500, 504), run=measure)


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """`grape reproduce ARGUMENTS` where row X8 is installed; exit code, output, errors."""
    monkeypatch.chdir(tmp_path)
    built_in = dict(plugins.BUILT_IN)
    built_in[plugins.EXPERIMENTS] = {"X8": f"{__name__}:EXPERIMENT"}
    monkeypatch.setattr(plugins, "BUILT_IN", built_in)
    monkeypatch.setitem(sys.modules, __name__, sys.modules[__name__])

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["grape", *arguments])
        with pytest.raises(SystemExit) as end:
            cli.main()
        captured = capsys.readouterr()
        return int(end.value.code or 0), captured.out, captured.err

    return call


def test_a_row_is_run_on_its_seeds_and_unmet_goals_are_shown(command: Command) -> None:
    code, out, err = command("reproduce", "X8")
    assert (code, err) == (0, "")
    for text in ("Counts seeds.", "500:504", "half of it", "1.5 mm", "1 … 2", "2 <b>", "yes", "no", "Counted by hand."):
        assert text in out


def test_the_json_has_the_schema(command: Command, tmp_path: Path) -> None:
    assert command("reproduce", "x8", "--seeds", "3:5", "--out", str(tmp_path / "out"))[0] == 0
    content = json.loads((tmp_path / "out/reproduce.json").read_text())
    assert (content["schema"], content["row"], content["seeds"]) == ("grape.reproduce/1", "X8", "3:5")
    counted, error, unknown = content["quantities"]
    assert counted == {
        "name": "counted", "unit": "1", "value": 2.0, "n": 2, "ci95": None, "reference": "", "goal": ">= 10",
        "met": False,
    }  # fmt: skip
    assert (error["ci95"], error["met"]) == ([1.0, 2.0], True)
    assert (unknown["value"], unknown["met"]) == (None, None)


def test_the_page_needs_no_other_file_and_shows_the_figures(command: Command, tmp_path: Path) -> None:
    command("reproduce", "X8", "--out", str(tmp_path / "out"))
    page = (tmp_path / "out/reproduce.html").read_text()
    assert re.findall(r'(?:src|href)="(?!data:)[^"#][^"]*"', page) == []
    for text in ("A line", '<path d="M0 0"/>', "2 &lt;b&gt;", "grape reproduce X8 --seeds 500:504", "Counted by hand."):
        assert text in page


def test_an_old_folder_goes_on_and_without_one_a_new_one_is_made(command: Command, tmp_path: Path) -> None:
    for _ in range(2):
        command("reproduce", "X8", "--out", "kept")
        command("reproduce", "X8")
    assert (tmp_path / "kept/count.txt").read_text() == "8"
    assert [(tmp_path / f"runs/reproduce-X8-{k}/count.txt").read_text() for k in (1, 2)] == ["4", "4"]


def test_stopping_says_how_to_go_on(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(seeds: Any, folder: Path, progress: Any) -> Proof:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"{__name__}.EXPERIMENT", Experiment(row="X8", summary="", seeds=range(2), run=stop))
    code, out, _ = command("reproduce", "X8", "--out", "kept")
    assert code == 130
    assert "`grape reproduce X8 --seeds 0:2 --out kept` goes on" in out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["X88"], "no experiment proves a row 'X88'; there are X8; did you mean 'X8'?"),
        (["X8", "--seeds", "5"], "did you mean 5:6?"),
        (["X8", "--seeds", "a:b"], "two whole numbers FIRST:LAST"),
        (["X8", "--out", "file.txt"], "it exists and is no folder"),
    ],
)
def test_wrong_input_ends_with_one(command: Command, tmp_path: Path, arguments: list[str], expected: str) -> None:
    (tmp_path / "file.txt").touch()
    code, _, err = command("reproduce", *arguments)
    assert code == 1 and expected in err


def test_rows_are_listed_in_the_order_of_their_numbers(command: Command) -> None:
    from rich.console import Console

    from grape.mission.listing import _natural, print_catalog

    assert sorted(["G10", "A2", "G10-x", "G8", "speed"], key=_natural) == ["A2", "G8", "G10", "G10-x", "speed"]
    console = Console(record=True, width=200)
    print_catalog(console)
    text = console.export_text()
    assert "grape reproduce X8" in text and "Counts seeds." in text and "grape bench manipulation" in text


@pytest.mark.parametrize("text", ["", "3", "3:", ":3", "5:3", "3:3", "-1:3", "1:2:3", "1.0:2", "²:3"])
def test_malformed_seeds_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match="seeds"):
        parse_seeds(text)


def test_seeds_exclude_their_last() -> None:
    assert parse_seeds("500:503") == range(500, 503)
