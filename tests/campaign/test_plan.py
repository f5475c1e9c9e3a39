"""Which missions a campaign runs, and which folders it refuses."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from paper_campaign import write_run
from paper_names import NAMES

from grape.campaign.plan import PLAN_FILE, keep_plan, make_jobs, make_plan, parse_variation
from grape.errors import FileError, InvalidInput

MISSION = "dispenser_deployment"


def test_varied_values_go_round_and_a_seed_always_means_the_same_mission(folder: Path) -> None:
    plan = make_plan(MISSION, ["dispensers=4"], ["world.style=cordon,gobelet", "world.sun=noon,low,overcast"])
    jobs = make_jobs(plan, range(500, 506), folder)
    assert len({job.settings for job in jobs}) == 6
    assert jobs[4].settings == make_jobs(plan, range(504, 505), folder)[0].settings
    assert jobs[0].settings[0] == "dispensers=4"


def test_a_job_can_be_run_again_by_one_command(folder: Path) -> None:
    plan = make_plan(MISSION, ["name=a b"], ["world.sun=low"])
    (job,) = make_jobs(plan, range(7, 8), folder)
    assert shlex.split(job.replay) == [
        "grape", "run", MISSION, "--seed", "7", "--set", "name=a b", "--set", "world.sun=low",
    ]  # fmt: skip
    assert job.command[3:] == (*shlex.split(job.replay)[1:], "--out", str(folder / "seed7"))


def test_a_job_with_growers_names_of_plants_can_be_run_again(folder: Path) -> None:
    setting = f"plants={json.dumps([{'plant': name} for name in NAMES], ensure_ascii=False)}"
    (job,) = make_jobs(make_plan(MISSION, [setting], []), range(7, 8), folder)
    assert shlex.split(job.replay)[-2:] == ["--set", setting]
    assert setting in job.command


@pytest.mark.parametrize("text", ["world.sun", "=a", "world.sun=", "world.sun=low,,noon", "world.sun=low,low"])
def test_malformed_variations_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match="--vary"):
        parse_variation(text)


@pytest.mark.parametrize(("settings", "vary"), [(["seed=3"], []), ([], ["seed=1,2"]), (["a=1"], ["a=2,3"])])
def test_a_key_cannot_have_two_masters(settings: list[str], vary: list[str]) -> None:
    with pytest.raises(InvalidInput, match=r"seeds come from --seeds|given twice"):
        make_plan(MISSION, settings, vary)


def test_too_many_combinations_are_refused() -> None:
    many = ",".join(str(value) for value in range(30))
    with pytest.raises(InvalidInput, match="729000000 combinations; allowed: at most 10000"):
        make_plan("dispenser_deployment", [], [f"key{k}={many}" for k in range(6)])


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff"])
def test_a_damaged_plan_is_named(folder: Path, content: bytes) -> None:
    (folder / PLAN_FILE).write_bytes(content)
    with pytest.raises(FileError, match=r"plan\.json: "):
        keep_plan(make_plan(MISSION, [], []), folder)


@pytest.mark.parametrize("content", [b"", b"[]", b"null", b'{"status": "succeeded"}', b"\xff"])
def test_a_damaged_result_is_named(folder: Path, content: bytes) -> None:
    (job,) = make_jobs(make_plan(MISSION, [], []), [0], folder)
    job.folder.mkdir(parents=True, exist_ok=True)
    (job.folder / "result.json").write_bytes(content)
    with pytest.raises(FileError, match=r"seed0/result\.json: "):
        job.result()


def test_every_varied_value_is_checked_before_anything_runs() -> None:
    with pytest.raises(FileError, match=r"gobletto.*did you mean 'gobelet'"):
        make_plan(MISSION, [], ["world.style=cordon,gobletto"]).check(0)


def test_a_folder_of_another_campaign_is_refused_with_the_difference(folder: Path) -> None:
    keep_plan(make_plan(MISSION, [], ["world.sun=noon,low"]), folder)
    keep_plan(make_plan(MISSION, [], ["world.sun=noon,low"]), folder)
    with pytest.raises(InvalidInput, match=r"vary: there \{'world.sun': \['noon', 'low'\]\}, here \{\}"):
        keep_plan(make_plan(MISSION, [], []), folder)


def test_a_folder_with_other_files_is_refused(folder: Path) -> None:
    (folder / "notes.txt").touch()
    with pytest.raises(InvalidInput, match="holds no campaign"):
        keep_plan(make_plan(MISSION, [], []), folder)


def test_a_mission_that_somebody_stopped_is_not_finished(folder: Path) -> None:
    (job,) = make_jobs(make_plan(MISSION, [], []), range(1), folder)
    assert job.result() is None
    write_run(job)
    assert job.result() is not None
    result = json.loads((job.folder / "result.json").read_text())
    (job.folder / "result.json").write_text(json.dumps(result | {"status": "aborted"}))
    assert job.result() is None
