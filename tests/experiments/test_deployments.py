"""Rows that missions prove, on made-up runs."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from paper_campaign import PaperEngine, write_run

from grape.campaign.plan import Job
from grape.experiments import deployments
from grape.mission.lock import RunLock
from grape.plugins import EXPERIMENTS, find

STARTED: list[int] = []  # seeds of the missions that were run


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Missions are made up: seed 3 fails on its vine and says so; a list for what progress was told."""

    STARTED.clear()

    def write(job: Job) -> None:
        STARTED.append(job.seed)
        if job.seed == 3:
            write_run(
                job,
                outcomes={"r0v1": "no_deployment_point"},
                hanging=("r0n0",),
                failures=(("r0v1", "FindDeploymentPoints", "no_deployment_point", 20.0),),
                checks=(("grasp", True, False),),
            )
        else:
            write_run(job)

    monkeypatch.setattr("grape.campaign.engines.LocalEngine", PaperEngine(write))
    return []


def test_hanging_is_counted_by_style_with_goals(said: list[str], tmp_path: Path) -> None:
    proof = deployments.G13.run(range(2, 4), tmp_path / "g13", lambda fraction, line: said.append(line))
    cordon, gobelet, account, lost, cycle, force, collided = proof.quantities
    assert (cordon.name, cordon.value, cordon.n, cordon.met) == ("hang by the referee, cordon", 1.0, 1, True)
    assert (gobelet.value, gobelet.n, gobelet.met) == (0.0, 1, False)
    assert (account.value, account.n, account.met) == (1.0, 2, True)
    assert lost.met and cycle.met and force.met and collided.met and proof.complete
    assert any("2 of 2 missions done" in line for line in said)
    assert "FindDeploymentPoints no_deployment_point (1)" in proof.notes[1]
    assert "<svg" in proof.figures[0].svg


def test_rows_share_their_missions_and_a_longer_row_runs_what_is_missing(said: list[str], tmp_path: Path) -> None:
    for experiment in (deployments.G12, deployments.G13, deployments.G9, deployments.G11, deployments.G15):
        assert experiment.run(range(2), tmp_path / experiment.row, lambda fraction, line: None).complete
    assert STARTED == [0, 1]
    deployments.G12.run(range(3), tmp_path / "G12", lambda fraction, line: None)
    assert STARTED == [0, 1, 2]


def test_open_and_closed_loop_are_shown_beside_each_other_on_the_same_plants(said: list[str], tmp_path: Path) -> None:
    alone = deployments.G14.run(range(2, 4), tmp_path / "G14", lambda fraction, line: None)
    assert not [q for q in alone.quantities if "same plants" in q.name]
    deployments.G13.run(range(3, 4), tmp_path / "G13", lambda fraction, line: None)
    proof = deployments.G14.run(range(2, 4), tmp_path / "G14", lambda fraction, line: None)
    (beside,) = [q for q in proof.quantities if q.name == "plant on the same plants, gobelet"]
    assert (beside.value, beside.n) == (0.0, 1), "seed 3 alone was run in closed loop"
    assert "1 of 1" in proof.figures[1].svg and len(STARTED) == 3


def test_the_second_base_has_missions_of_its_own_and_both_kinds_of_plants_count(
    said: list[str], tmp_path: Path
) -> None:
    deployments.G13.run(range(2, 3), tmp_path / "G13", lambda fraction, line: None)
    proof = deployments.G19.run(range(2, 4), tmp_path / "G19", lambda fraction, line: None)
    found = {quantity.name: quantity for quantity in proof.quantities}
    assert STARTED == [2, 2, 3] and "robot=robi_jaco2" in deployments.ROBI.settings and proof.complete
    nails, vines = (found[f"{kind} that hang by the referee, gobelet"] for kind in ("nails", "vines"))
    assert nails.met and not vines.met
    assert (found["account agrees with the referee"].n, found["fences crossed"].value) == (4, 0.0)
    assert found["position error of a mission, root mean square, median"].n == 2


def test_a_row_that_is_stopped_shows_what_is_done(
    said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(fraction: float, line: str) -> None:
        if "2 of 20" in line:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    proof = deployments.G13.run(range(20), tmp_path / "G13", stop)
    assert not proof.complete and 2 <= proof.quantities[0].n + proof.quantities[1].n < 20
    assert "of 20 missions" in proof.notes[0]


def test_a_row_reads_what_is_done_while_another_process_runs_the_rest(said: list[str], tmp_path: Path) -> None:
    deployments.G12.run(range(2), tmp_path / "G12", lambda fraction, line: None)
    with RunLock(tmp_path / "campaign-closed-loop"):
        proof = deployments.G11.run(range(4), tmp_path / "G11", lambda fraction, line: None)
    assert not proof.complete and proof.quantities[0].n == 2


def test_a_check_is_judged_by_its_wrong_answers(said: list[str], tmp_path: Path) -> None:
    proof = deployments.G11.run(range(4), tmp_path / "G11", lambda fraction, line: None)
    yes, no, not_so = proof.quantities
    assert (yes.value, yes.n, yes.met) == (0.25, 4, False)
    assert (no.value, no.n, no.met) == (None, 0, None)
    assert (not_so.value, not_so.n) == (1.0, 1)
    feeder = deployments.G9.run(range(4), tmp_path / "G9", lambda fraction, line: None)
    assert feeder.quantities[3].name == "named a level that was not on top"


def test_the_rows_are_plugins_and_report_on_seeds_that_nothing_was_tuned_on() -> None:
    for name in ("G9", "G11", "G12-hanging", "G13-hanging", "G14", "G15", "G19"):
        experiment = find(EXPERIMENTS)[name].load()
        assert experiment.row == name
        assert experiment.seeds.start >= 500 and experiment.seeds.stop <= 1000
