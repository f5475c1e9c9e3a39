"""Going on in a run folder: what is taken up, what is repaired, and which folders are refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from paper_campaign import write_run

from grape.actions.account import RESUMED
from grape.actions.core import Context, Outcome, Status
from grape.campaign.plan import make_jobs, make_plan
from grape.errors import FileError, InvalidInput
from grape.mission.file import Mission
from grape.mission.launch import finish, identity, refuse_changed, refuse_lost_world, resume_mission, write_inputs
from grape.mission.ledger import SqliteLedger
from grape.mission.lock import RunLock
from grape.mission.record import RunRecorder, read_events
from grape.mission.track import Track

Make = Callable[..., Any]


def killed_session(make_runner: Make, serve: Callable[..., None], folder: Path) -> None:
    """A session that serves one plant, begins the next, and is gone in the middle of an event."""

    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 150:
            serve(context, "r0v1", Outcome.DEPLOYED)
            context.log.event("plant_started", plant="r0n0", mode="nail")
            step = context.ledger.step("release", "r0n0", target={})
            step.__enter__()
            context.ledger.finish("r0n0", Outcome.DEPLOYED)
            raise SystemExit  # as sudden as the test process can bear
        return None

    runner, _ = make_runner(script)
    with pytest.raises(SystemExit):
        runner.run()
    with (folder / "events.jsonl").open("a") as file:
        file.write('{"t": 1.5, "kind": "ac')
    with (folder / "track.csv").open("a") as file:
        file.write("1.4,2.0,")


def test_a_killed_mission_goes_on_in_its_folder(
    make_runner: Make, serve: Callable[..., None], mission: Mission, backend: Any, tmp_path: Path
) -> None:
    killed_session(make_runner, serve, tmp_path)
    before = [event for event in read_events(tmp_path / "events.jsonl")]
    wall_s = Track(tmp_path / "track.csv").wall_s
    left: list[str] = []

    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 1:
            assert context.world.committed[RESUMED]
            left.extend(task.plant for task in context.ledger.plants() if task.outcome is None)
        return Status.SUCCEEDED if ticks == 5 else None

    runner, _ = make_runner(script, resume=True)
    result = finish(mission, runner, backend, tmp_path)
    assert left == ["r1n1", "r1v1"], "what has an outcome is not served again"
    events = list(read_events(tmp_path / "events.jsonl"))
    assert events[: len(before)] == before
    resumed, told = events[len(before) : len(before) + 2]
    assert (resumed["kind"], resumed["session"], resumed["step"], resumed["plant"], resumed["outcome"]) == (
        "mission_resumed", 2, "release", "r0n0", None,
    )  # fmt: skip
    assert (told["kind"], told["plant"]) == ("plant_finished", "r0n0"), "written down before the kill, told after it"
    assert [event["kind"] for event in events].count("mission_started") == 1
    assert result["sim_time_s"] > 1.49 and result["wall_time_s"] > wall_s > 0
    assert [plant["outcome"] for plant in result["plants"][:2]] == ["deployed", "deployed"]
    assert result["plants"][0]["phases_s"]["DriveToPlant"] == 20.0, "of the first session"
    rows = (tmp_path / "path.csv").read_text().splitlines()
    times = [float(row.split(",")[0]) for row in rows[1:]]
    assert times == sorted(times) and times[0] < 1.3 < times[-1]


def test_plants_that_ctrl_c_has_closed_are_open_again(
    make_runner: Make, mission: Mission, backend: Any, tmp_path: Path
) -> None:
    runner, _ = make_runner(lambda context, ticks: None, cancelled=lambda: backend.beats >= 5)
    assert finish(mission, runner, backend, tmp_path)["status"] == "aborted"
    seen: list[Any] = []

    def script(context: Context, ticks: int) -> Status:
        seen.extend(task.outcome for task in context.ledger.plants())
        return Status.SUCCEEDED

    runner, _ = make_runner(script, resume=True)
    result = finish(mission, runner, backend, tmp_path)
    assert seen == [None] * 4 and result["ended_by"] == "tree"


def test_a_mission_killed_before_its_ledger_starts_anew(make_runner: Make, tmp_path: Path) -> None:
    runner, _ = make_runner(lambda context, ticks: Status.SUCCEEDED, resume=True)
    assert runner.run().ended_by == "tree"
    assert next(read_events(tmp_path / "events.jsonl"))["kind"] == "mission_started"


def test_a_run_that_has_ended_stays_as_it_is(tmp_path: Path) -> None:
    (job,) = make_jobs(make_plan("dispenser_deployment", [], []), [0], tmp_path)
    write_run(job, status="partial")
    content = (job.folder / "result.json").read_text()
    done = resume_mission(job.folder)
    assert not done.resumed and done.result["status"] == "partial"
    assert (job.folder / "result.json").read_text() == content


def test_a_report_that_a_kill_has_cut_off_is_written_again(
    make_runner: Make, backend: Any, mission: Mission, tmp_path: Path
) -> None:
    runner, _ = make_runner(lambda context, ticks: Status.SUCCEEDED)
    finish(mission, runner, backend, tmp_path)
    (tmp_path / "report.html").unlink()
    assert not resume_mission(tmp_path).resumed
    assert (tmp_path / "report.html").exists()


@pytest.mark.parametrize("damage", ["0.2,\0\0\n", "0.2,1,2\n", "a,b,c,d,e,f\n"])
def test_a_damaged_track_is_named_with_its_line(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "track.csv"
    Track(path).close()
    with path.open("a") as file:
        file.write("0.0,1.0,2.0,0.0,0.0,0.1\n" + damage)
    with pytest.raises(FileError, match=r"track\.csv:3: damaged"):
        Track(path)


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", "\N{BYTE ORDER MARK}", '{"ended_by": "tree"}'])
def test_a_damaged_result_is_named(mission: Mission, tmp_path: Path, content: str) -> None:
    write_inputs(mission, tmp_path)
    (tmp_path / "result.json").write_text(content)
    with pytest.raises(FileError, match=r"result\.json: "):
        resume_mission(tmp_path)


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"no run folder.*mission\.yaml"):
        resume_mission(tmp_path)
    with pytest.raises(InvalidInput, match="no run folder"):
        resume_mission(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda folder: (folder / "mission.yaml").open("a").write("# more\n"), "differ from those"),
        (lambda folder: (folder / "tree.xml").unlink(), "tree.xml of the run is missing"),
        (lambda folder: note(folder, "grape", "0.0.1"), "grape 0.0.1 began this run"),
    ],
)
def test_changed_runs_are_refused(
    mission: Mission, tmp_path: Path, change: Callable[[Path], Any], message: str
) -> None:
    write_inputs(mission, tmp_path)
    SqliteLedger.create(tmp_path / "ledger.sqlite", [("a", "nail")], 1, identity(tmp_path)).close()
    refuse_changed(tmp_path)
    change(tmp_path)
    with pytest.raises(InvalidInput, match=message):
        refuse_changed(tmp_path)


def note(folder: Path, key: str, value: str) -> None:
    ledger = SqliteLedger.open(folder / "ledger.sqlite")
    ledger.note(key, value)
    ledger.close()


def test_a_simulated_run_whose_world_is_gone_is_refused_once_something_was_done(
    mission: Mission, tmp_path: Path
) -> None:
    write_inputs(mission, tmp_path)
    ledger = SqliteLedger.create(tmp_path / "ledger.sqlite", [("a", "nail")], 1, identity(tmp_path))
    refuse_lost_world(tmp_path)
    with ledger.step("drive"):
        pass
    ledger.close()
    for make in (lambda: None, (tmp_path / "world").mkdir):
        make()
        with pytest.raises(InvalidInput, match="simulated world, world/, is gone or damaged"):
            resume_mission(tmp_path)


def test_a_second_process_in_the_same_folder_is_refused(mission: Mission, tmp_path: Path) -> None:
    write_inputs(mission, tmp_path)
    program = (
        "import sys; from pathlib import Path; from grape.mission.lock import RunLock\n"
        "with RunLock(Path(sys.argv[1])):\n    print('held', flush=True); sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        with pytest.raises(InvalidInput, match="another process"):
            resume_mission(tmp_path)
        other.kill()
        other.wait()
    with RunLock(tmp_path):
        pass


def test_pictures_go_on_with_the_next_number(tmp_path: Path) -> None:
    import numpy as np

    clock = type("Clock", (), {"now": staticmethod(lambda: 1.0)})()
    picture = np.zeros((4, 5, 3), np.uint8)
    first = RunRecorder(tmp_path, clock)
    first.picture("grasp", picture)
    first.close()
    seen: list[Any] = []
    again = RunRecorder(tmp_path, clock, observer=seen.append, resume=True)
    assert [event["kind"] for event in seen] == ["picture"]
    again.picture("grasp", picture)
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == ["001_grasp.png", "002_grasp.png"]
