"""A campaign from its jobs to campaign.json and its page, on made-up runs."""

from __future__ import annotations

import io
import json
import re
import sys
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from paper_campaign import PaperEngine, write_run
from rich.console import Console

from grape import cli
from grape.campaign.command import read_campaign, run_campaign
from grape.campaign.plan import Job, make_jobs, make_plan
from grape.campaign.reading import Check, read_run
from grape.campaign.summary import confusion
from grape.campaign.watch import Standing, StandingDisplay
from grape.errors import InvalidInput
from grape.mission.lock import RunLock

PLAN = make_plan("dispenser_deployment", [], ["world.style=cordon,gobelet", "world.slope=0.03,0.1"])


def two_bad_missions(job: Job) -> None:
    """Seed 1 finds no spur, seed 2 loses a dispenser without knowing, the others are perfect."""
    if job.seed == 1:
        no_spur = ("FindDeploymentPoints", "no_deployment_point")
        write_run(
            job,
            outcomes={"r0v1": "no_deployment_point"},
            hanging=("r0n0",),
            failures=(
                ("r0v1", "ServoToSpur", "feature_lost", 20.0),
                ("r0v1", *no_spur, 25.0),
                ("r0v1", *no_spur, 30.0),
                ("r0v1", "HoldsDispenser", "grasp_failed", 31.0),
            ),
            checks=(("feeder", False, False), ("grasp", False, True)),
            status="partial",
        )
    elif job.seed == 2:
        write_run(job, hanging=("r0v1",), dropped=1, checks=(("grasp", True, True), ("deployment", True, False)))
    else:
        write_run(job)


@pytest.fixture
def summary(folder: Path) -> Any:
    run_campaign(PLAN, range(4), folder, PaperEngine(two_bad_missions))
    return json.loads((folder / "campaign.json").read_text())


def test_groups_carry_mode_conditions_and_rates(summary: Any) -> None:
    assert summary["schema"] == "grape.campaign/1" and summary["missions"] == 4
    groups = {(g["mode"], g["style"], g["varied"]["world.slope"]): g for g in summary["groups"]}
    assert len(groups) == 8  # 2 modes in 4 combinations
    bad = groups["plant", "cordon", 0.1]  # seed 1
    assert (bad["n"], bad["hanging"], bad["rate"], bad["cycle_s_median"]) == (1, 0, 0.0, None)
    assert bad["wilson95"] == pytest.approx([0.0, 0.793], abs=0.001)
    assert (bad["light"], bad["arm_errors"]) == ("noon", 0.0)
    modes = {entry["value"]: entry["hanging"] for entry in summary["by"]["mode"]}
    assert modes == {"plant": 3, "nail": 3}


def test_the_robots_account_is_held_against_the_referee(summary: Any) -> None:
    assert summary["account_agreement"] == pytest.approx(7 / 8)
    assert summary["lost_unnoticed"] == 1
    assert summary["max_plant_force_n"] == 4.0
    assert summary["checks"] == {
        "grasp": {"positive": "a dispenser is on the hand", "tp": 3, "fp": 0, "tn": 0, "fn": 1},
        "feeder": {"positive": "a dispenser is in the feeder", "tp": 0, "fp": 0, "tn": 1, "fn": 0},
        "deployment": {"positive": "a dispenser hangs on the plant", "tp": 0, "fp": 1, "tn": 0, "fn": 0},
    }


def test_the_level_that_the_robot_named_is_judged_beside_its_yes() -> None:
    looks = [(True, True, True), (True, True, True), (True, True, False), (True, False, None), (False, False, None)]
    (table,) = confusion(Check(name="feeder", said=s, true=t, level_right=r) for s, t, r in looks).values()
    assert (table["tp"], table["fp"], table["tn"], table["fn"]) == (3, 1, 1, 0)
    assert (table["level_right"], table["level_wrong"]) == (2, 1)


def test_a_named_level_is_held_against_the_level_that_the_referee_saw(folder: Path) -> None:
    (job,) = make_jobs(PLAN, range(1), folder)
    write_run(job, checks=(("feeder", True, True), ("feeder", True, True)), levels=((6, 6), (6, 5)))
    run = read_run(job, job.result() or {})
    assert [check.level_right for check in run.checks] == [True, False]


def test_failures_have_a_cause_a_picture_and_a_command(summary: Any) -> None:
    no_spur, miscount, lost = summary["failures"]
    assert (no_spur["action"], no_spur["reason"], no_spur["time_s"]) == (
        "FindDeploymentPoints", "no_deployment_point", 30.0,
    )  # fmt: skip
    assert no_spur["picture"] == "seed1/pictures/001_grasp.png"
    assert no_spur["replay"] == (
        "grape run dispenser_deployment --seed 1 --set world.style=cordon --set world.slope=0.1"
    )
    assert (miscount["plant"], miscount["action"]) == ("r0n0", "account")
    assert (lost["plant"], lost["action"], lost["reason"]) == ("", "account", "lost unnoticed")
    assert "1 at r0n0" in lost["detail"]
    assert summary["taxonomy"] == [
        {"action": "FindDeploymentPoints", "reason": "no_deployment_point", "times": 2, "plants": 1},
        {"action": "account", "reason": "counted but does not hang", "times": 1, "plants": 1},
        {"action": "account", "reason": "lost unnoticed", "times": 1, "plants": 1},
        {"action": "ServoToSpur", "reason": "feature_lost", "times": 1, "plants": 0},
    ]


def test_failures_tell_growers_names_of_plants_as_they_are(folder: Path) -> None:
    names = {"r0v1": "<b>x", "r0n0": "a/b [red]é"}

    def write(job: Job) -> None:
        two_bad_missions(job)
        for path in (job.folder / "result.json", job.folder / "events.jsonl"):
            text = path.read_text()
            for old, name in names.items():
                text = text.replace(json.dumps(old), json.dumps(name))
            path.write_text(text)

    run_campaign(PLAN, range(1, 3), folder, PaperEngine(write))
    no_spur, miscount, lost = json.loads((folder / "campaign.json").read_text())["failures"]
    assert (no_spur["plant"], no_spur["time_s"], miscount["plant"]) == ("<b>x", 30.0, "a/b [red]é")
    assert "1 at a/b [red]é" in lost["detail"]
    page = (folder / "report.html").read_text()
    assert "<b>x" not in page and all(f"{escape(name)} (" in page for name in names.values())


def test_what_is_varied_is_shown_as_it_is_while_missions_run(folder: Path) -> None:
    jobs = make_jobs(make_plan("dispenser_deployment", [], ['plants.0.plant="[red]y","[/b]"']), range(2), folder)
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    with StandingDisplay(console) as display:
        display.show(Standing(jobs=jobs, running=jobs))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    assert '"[red]y"' in shown and '"[/b]"' in shown


def test_times_by_phase(summary: Any) -> None:
    assert {"mode": "nail", "phase": "Retract", "n": 4, "median_s": 5.0, "p90_s": 5.0} in summary["phases"]


def test_the_page_holds_everything_and_its_drawings_are_well_formed(summary: Any, folder: Path) -> None:
    page = (folder / "report.html").read_text()
    for text in (
        "no deployment point",
        "data:image/jpeg;base64,",
        "--seed 1",
        "FindDeploymentPoints &lt; 3",
        "gobelet",
    ):
        assert text in page
    assert re.findall(r'src="(?!data:)[^"]*"', page) == []
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert drawings
    for drawing in drawings:
        ElementTree.fromstring(drawing)


def test_finished_missions_are_read_and_unfinished_ones_run_again(folder: Path) -> None:
    run_campaign(PLAN, range(2), folder, PaperEngine(write_run))
    (folder / "seed1" / "result.json").unlink()
    engine = PaperEngine(write_run)
    done = run_campaign(PLAN, range(3), folder, engine)
    assert engine.started == [1, 2] and engine.stopped
    assert done.summary["missions"] == 3


def test_what_is_done_can_be_read_while_another_process_runs_the_rest(folder: Path) -> None:
    run_campaign(PLAN, range(2), folder, PaperEngine(write_run))
    engine = PaperEngine(write_run)
    with RunLock(folder), pytest.raises(InvalidInput, match="another process"):
        run_campaign(PLAN, range(8), folder, engine)
    assert engine.started == []
    assert read_campaign(PLAN, range(8), folder).summary["missions"] == 2
    assert read_campaign(PLAN, range(8), folder / "nothing").summary["total"]["n"] == 0


def test_a_finished_campaign_needs_no_engine(folder: Path) -> None:
    run_campaign(PLAN, range(2), folder, PaperEngine(write_run))
    engine = PaperEngine(write_run)
    run_campaign(PLAN, range(2), folder, engine)
    assert engine.started == [] and not engine.stopped


def test_a_mission_without_a_result_is_a_failure_with_its_last_words(folder: Path) -> None:
    def write(job: Job) -> None:
        if job.seed == 0:
            job.log.write_text("working\nout of memory\n")
        else:
            write_run(job)

    done = run_campaign(PLAN, range(2), folder, PaperEngine(write))
    assert done.summary["without_result"] == [0]
    (failure,) = done.summary["failures"]
    assert (failure["action"], failure["detail"], failure["plant"]) == ("process", "out of memory", "")


def test_cancelling_ends_what_runs_and_reports_what_is_done(folder: Path) -> None:
    engine = PaperEngine(write_run)
    done = run_campaign(PLAN, range(8), folder, engine, cancelled=lambda: len(engine.started) > 2)
    assert engine.stopped and 1 <= done.summary["missions"] < 8


def test_no_more_missions_run_than_there_are_workers(folder: Path) -> None:
    sizes: list[int] = []

    class Counting(PaperEngine):
        def ended(self) -> list[Job]:
            sizes.append(len(self._running))
            return super().ended()

    run_campaign(PLAN, range(5), folder, Counting(write_run), workers=2)
    assert max(sizes) == 2


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["dispenser_deploymnt", "--seeds", "0:2"], "did you mean 'dispenser_deployment'?"),
        (["dispenser_deployment", "--seeds", "5"], "did you mean 5:6?"),
        (["dispenser_deployment", "--seeds", "0:2", "--engine", "rai"], "did you mean 'ray'?"),
        (["dispenser_deployment", "--seeds", "0:2", "--vary", "world.sun=noon,lo"], "did you mean 'low'?"),
        (["dispenser_deployment"], "Missing option '--seeds'"),
    ],
)
def test_wrong_input_ends_with_one_and_leaves_no_folder(
    arguments: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["grape", "campaign", *arguments, "--out", str(tmp_path / "new")])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_the_command_says_how_many_hang(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("grape.campaign.command.engine_named", lambda name: PaperEngine(two_bad_missions))
    arguments = ["grape", "campaign", "dispenser_deployment", "--seeds", "0:3", "--out", str(folder)]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 0
    out = capsys.readouterr().out
    assert "2 of 3" in out and "66.7 %" in out and "account right 83.3 %" in out


def test_a_failure_shows_the_picture_that_its_own_action_took(folder: Path) -> None:
    job = Job(seed=0, settings=(), varied={}, folder=folder / "seed0", command=(), replay="")
    write_run(job, hanging=("r0n0",), outcomes={"r0v1": "feature_lost"})
    path = job.folder / "events.jsonl"
    kept, finished = path.read_text().splitlines()[:-2], path.read_text().splitlines()[-2:]
    more = (
        {"t": 70.0, "kind": "picture", "name": "ServoToSpur_feature_lost", "file": "pictures/002.png"},
        {"t": 72.0, "kind": "action", "name": "ServoToSpur", "status": "aborted", "reason": "feature_lost",
         "detail": "", "start": 66.0, "end": 72.0},
        {"t": 72.5, "kind": "picture", "name": "grasp", "file": "pictures/003.png"},
    )  # fmt: skip
    path.write_text("\n".join([*kept, *map(json.dumps, more), *finished]) + "\n")
    vine = read_run(job, json.loads((job.folder / "result.json").read_text())).plants[1]
    assert [failure.picture for failure in vine.failures] == ["pictures/002.png"]
