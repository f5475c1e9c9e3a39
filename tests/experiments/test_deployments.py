"""Rows that missions prove, on made-up runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from paper_campaign import PaperEngine, write_run

from grape.campaign.plan import Job
from grape.experiments import deployments
from grape.plugins import EXPERIMENTS, find


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Missions are made up: seed 3 fails on its vine and says so; a list for what progress was told."""

    def write(job: Job) -> None:
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
    proof = deployments.G13.run(range(2, 4), tmp_path, lambda fraction, line: said.append(line))
    cordon, gobelet, account, lost, cycle, force = proof.quantities
    assert (cordon.name, cordon.value, cordon.n, cordon.met) == ("hang by the referee, cordon", 1.0, 2, True)
    assert (gobelet.value, gobelet.met) == (0.5, False)
    assert (account.value, account.met, lost.met, cycle.met, force.met) == (1.0, True, True, True, True)
    assert any("2 of 2 missions done" in line for line in said)
    assert "FindDeploymentPoints no_deployment_point (1)" in proof.notes[1]
    assert "<svg" in proof.figures[0].svg


def test_a_check_is_judged_by_its_wrong_answers(said: list[str], tmp_path: Path) -> None:
    proof = deployments.G11.run(range(4), tmp_path, lambda fraction, line: None)
    yes, no = proof.quantities
    assert (yes.value, yes.n, yes.met) == (0.25, 4, False)
    assert (no.value, no.n, no.met) == (None, 0, None)


def test_the_rows_are_plugins_and_report_on_seeds_that_nothing_was_tuned_on() -> None:
    for name in ("G9", "G11", "G12-hanging", "G13-hanging", "G14", "G15"):
        experiment = find(EXPERIMENTS)[name].load()
        assert experiment.row == name
        assert experiment.seeds.start >= 500 and experiment.seeds.stop <= 1000
