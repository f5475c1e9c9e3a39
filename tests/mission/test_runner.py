"""The beat: what is sensed, how a run ends, and that its folder is complete whatever happens."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grape.actions.core import Context, Outcome, Status
from grape.mission.file import Mission
from grape.mission.launch import finish
from grape.mission.progress import Progress
from grape.mission.record import read_events
from grape.mission.result import status_of, without_wall_clock
from grape.mission.runner import Finding

Make = Callable[..., Any]
FILES = {"result.json", "events.jsonl", "report.html", "ledger.sqlite", "path.csv", "drive.jsonl", "standing.csv"}


def end_at(tick: int) -> Callable[[Context, int], Status | None]:
    return lambda context, ticks: Status.SUCCEEDED if ticks == tick else None


def test_sense_fills_the_world_before_the_first_tick(make_runner: Make, backend: Any) -> None:
    seen: list[Any] = []

    def script(context: Context, ticks: int) -> Status | None:
        world = context.world
        seen.append((world.arm, world.gripper, world.odometry, world.localized))
        if ticks == 150:
            T_map_hand = world.frames.lookup("map", "hand")
            x, y = world.site.start
            np.testing.assert_allclose(T_map_hand[:3, 3], [x + 0.45, y + 0.20, 0.13 + 0.958], atol=0.05)
            assert {"velodyne", "camera_optical", "wrist_lidar", "front_laser"} <= world.frames.frames()
            return Status.SUCCEEDED
        return None

    make_runner(script)[0].run()
    assert seen[0][0] is not None and seen[0][1] is not None
    assert seen[-1][3], "wheels, IMU and GNSS localise a standing robot"
    assert len(backend.estimates) >= 149, "the referee is shown the estimate every beat"


def test_the_referee_is_told_of_every_look_and_of_nothing_else(make_runner: Make, backend: Any) -> None:
    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 1:
            context.log.event("plant_started", plant="r0n0", mode="nail")
            context.log.event("check", check="grasp", value=True)
            context.log.event("scan", plant="r0n0")
            context.log.event("settled", step="grasp")
        return Status.SUCCEEDED if ticks == 2 else None

    runner, _ = make_runner(script)
    runner.run()
    runner.close()
    assert backend.witnessed == [("grasp", "r0n0"), ("settled", "r0n0")]


def test_what_the_camera_saw_is_kept_when_an_action_fails_and_not_when_a_question_is_answered(
    make_runner: Make, backend: Any
) -> None:
    backend.buffers["camera"].messages = [SimpleNamespace(stamp=0.0, bgr=np.zeros((4, 4, 3), np.uint8))]

    def script(context: Context, ticks: int) -> Status | None:
        for name, start, status in (("Servo", 0.0, "aborted"), ("Servo", 0.0, "succeeded"), ("Holds", 0.99, "aborted")):
            context.log.event("action", name=name, status=status, start=start, end=1.0, reason="x", detail="")
        return Status.SUCCEEDED

    runner, _ = make_runner(script)
    runner.run()
    runner.close()
    events = list(read_events(runner.log._folder / "events.jsonl"))
    assert [event["name"] for event in events if event["kind"] == "picture"] == ["failed_Servo"]
    assert (runner.log._folder / "pictures/001_failed_Servo.png").is_file()


def test_a_resumed_mission_does_not_look_again_at_what_was_looked_at(make_runner: Make, backend: Any) -> None:
    def script(context: Context, ticks: int) -> Status | None:
        context.log.event("check", check="grasp", value=True)
        context.log.event("action", name="Servo", status="aborted", start=0.0, end=1.0, reason="x", detail="")
        return Status.SUCCEEDED

    runner, _ = make_runner(script)
    runner.run()
    runner.close()
    assert len(backend.witnessed) == 1
    again, _ = make_runner(lambda context, ticks: Status.SUCCEEDED, folder=runner.log._folder, resume=True)
    again.close()
    assert len(backend.witnessed) == 1
    events = list(read_events(runner.log._folder / "events.jsonl"))
    assert [event["kind"] for event in events if "picture" in event["kind"]] == ["no_picture"]


def test_a_mission_ends_when_its_tree_ends_and_the_robot_stands(make_runner: Make, backend: Any) -> None:
    runner, trees = make_runner(end_at(10))
    finding = runner.run()
    assert (finding.ended_by, trees[0].ticks) == ("tree", 10)
    assert finding.sim_time_s == pytest.approx(0.09)
    assert all(backend.buffers[name].stops for name in ("base", "arm", "gripper"))


def test_a_failed_tree_names_the_action_that_failed(make_runner: Make) -> None:
    def script(context: Context, ticks: int) -> Status:
        return Status.ABORTED

    runner, _ = make_runner(script)
    make_tree = runner._make_tree

    def failing(context: Context) -> Any:
        tree = make_tree(context)
        tree.last_failure = SimpleNamespace(path="Main/MoveArm", reason="no_plan", detail="blocked")
        return tree

    runner._make_tree = failing
    assert runner.run().detail == "Main/MoveArm: no_plan: blocked"


def test_actions_get_the_missions_defaults(make_runner: Make, mission: Mission) -> None:
    object.__setattr__(mission, "actions", {"ScanVine": {"speed": 0.1}})
    runner, _ = make_runner(lambda context, ticks: Status.SUCCEEDED)
    assert runner.context.config == {"ScanVine": {"speed": 0.1}}


def test_the_time_limit_ends_a_mission(make_runner: Make, mission: Mission) -> None:
    object.__setattr__(mission, "file", mission.file.model_copy(update={"time_limit_s": 0.2}))
    runner, trees = make_runner(end_at(1000))
    assert runner.run().ended_by == "time_limit"
    assert trees[0].halted
    assert {task.reason for task in runner.ledger.plants()} == {"time_limit"}


def test_cancelling_halts_the_tree_and_completes_the_folder(make_runner: Make, backend: Any, mission: Mission) -> None:
    runner, trees = make_runner(end_at(1000), cancelled=lambda: backend.beats >= 5)
    folder = runner.log._folder
    result = finish(mission, runner, backend, folder)
    assert result["status"] == "aborted" and trees[0].halted
    assert {path.name for path in folder.iterdir()} >= FILES
    assert {plant["reason"] for plant in result["plants"]} == {"aborted"}


def test_a_crash_stops_the_robot_fails_the_plant_in_hand_and_names_the_error(
    make_runner: Make, backend: Any, mission: Mission
) -> None:
    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 3:
            context.log.event("plant_started", plant="r0v1", mode="plant")
        if ticks == 5:
            raise ZeroDivisionError("oops")
        return None

    runner, trees = make_runner(script)
    result = finish(mission, runner, backend, runner.log._folder)
    assert (result["status"], result["detail"]) == ("failed", "ZeroDivisionError: oops")
    assert (result["plants"][0]["outcome"], result["plants"][0]["reason"]) == ("failed", "internal_error")
    assert result["plants"][1]["reason"] == "not_served"
    assert trees[0].halted and backend.buffers["arm"].stops


def test_a_backend_that_breaks_while_stopping_still_gets_a_folder(
    make_runner: Make, backend: Any, mission: Mission, monkeypatch: pytest.MonkeyPatch
) -> None:
    def explode() -> None:
        raise RuntimeError("physics has diverged")

    monkeypatch.setattr(backend, "advance", explode)
    runner, _ = make_runner(end_at(10))
    result = finish(mission, runner, backend, runner.log._folder)
    assert result["status"] == "failed"
    assert "stopping failed: RuntimeError: physics has diverged" in result["detail"]


def test_a_tree_that_cannot_be_halted_still_leaves_a_robot_that_stands(make_runner: Make, backend: Any) -> None:
    runner, _ = make_runner(end_at(1000), cancelled=lambda: backend.beats >= 5)
    make_tree = runner._make_tree

    def stubborn(context: Context) -> Any:
        tree = make_tree(context)

        def halt() -> None:
            raise RuntimeError("will not")

        tree.halt = halt
        return tree

    runner._make_tree = stubborn
    finding = runner.run()
    assert (finding.ended_by, finding.detail) == ("aborted", "stopping failed: RuntimeError: will not")
    assert all(backend.buffers[name].stops for name in ("base", "arm", "gripper"))
    assert backend.beats == 105, "and has come to rest"


def test_the_result_has_every_field_of_the_schema(
    make_runner: Make, backend: Any, mission: Mission, serve: Callable[..., None]
) -> None:
    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 2:
            serve(context, "r0v1", Outcome.DEPLOYED)
            serve(context, "r0n0", Outcome.SKIPPED, "not_converged")
            failed = {"converged": False, "reason": "feature_lost", "error_px": float("inf"), "iterations": 3}
            context.log.event("servo", action="ServoToNail", **failed)
            context.log.event("recovery", how="retreat", why="4.0 cm to the left of the goal")
        return Status.SUCCEEDED if ticks == 5 else None

    runner, _ = make_runner(script)
    folder = runner.log._folder
    result = finish(mission, runner, backend, folder)
    assert result == json.loads((folder / "result.json").read_text())
    assert {"schema", "mission", "robot", "seed", "status", "sim_time_s", "wall_time_s", "real_time_factor"} <= set(
        result
    )
    assert (result["schema"], result["status"]) == ("grape.result/1", "partial")
    first = result["plants"][0]
    assert {"id", "mode", "outcome", "reason", "attempts", "cycle_s", "phases_s", "servo"} <= set(first)
    assert first["cycle_s"] == pytest.approx(19.0)
    assert first["phases_s"] == {"DriveToPlant": 20.0, "ServoToFeeder": 8.0, "HangDispenser": 6.0, "Retract": 5.0}
    assert (first["servo"]["error_px"], first["servo"]["iterations"], first["attempts"]) == (1.5, 80, 1)
    second = result["plants"][1]
    assert second["reason"] == "not_converged"
    runs = [(run["converged"], run["reason"]) for run in second["servo"]["runs"]]
    assert runs == [(True, ""), (False, "feature_lost")]
    assert (second["servo"]["error_px"], second["servo"]["iterations"]) == (1.5, 80), "of the last that converged"
    assert result["dispensers"] == {"loaded": 8, "deployed": 1, "left": 6, "lost": 1, "on_hand": 0}
    assert result["truth"] == backend.verdict()["truth"]
    assert result["localization"] == {"position_rmse_m": 0.0123, "yaw_rmse_deg": 0.5, "max_error_m": 0.03}
    assert result["navigation"] == {"distance_m": 0.0, "recoveries": 1}


def test_the_same_run_twice_gives_the_same_files(
    make_runner: Make, mission: Mission, backend: Any, serve: Callable[..., None], tmp_path: Path
) -> None:
    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 2:
            serve(context, "r0v1", Outcome.DEPLOYED)
            context.log.event("draw", value=context.rng.random(3))
        return Status.SUCCEEDED if ticks == 5 else None

    results, events = [], []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        fresh = type(backend)(mission)
        runner, _ = make_runner(script, backend=fresh, folder=tmp_path / name)
        results.append(without_wall_clock(finish(mission, runner, fresh, tmp_path / name)))
        events.append((tmp_path / name / "events.jsonl").read_bytes())
    assert results[0] == results[1]
    assert events[0] == events[1]


def test_progress_tells_phase_plant_and_times(make_runner: Make, serve: Callable[..., None]) -> None:
    shown: list[Progress] = []

    def script(context: Context, ticks: int) -> Status | None:
        if ticks == 1:
            serve(context, "r0v1", Outcome.DEPLOYED)
            context.log.event("plant_started", plant="r0n0", mode="nail")
            context.log.event("action", name="Unwind", status="active", start=0.0, end=None)
        return Status.SUCCEEDED if ticks == 5 else None

    runner, _ = make_runner(script, on_progress=shown.append)
    runner.run()
    assert (shown[0].phase, shown[0].plant, shown[0].percent) == ("Unwind", "r0n0", 25.0)
    assert shown[0].real_time_factor >= 0.0


@pytest.mark.parametrize(
    ("ended_by", "outcomes", "status"),
    [
        ("tree", [Outcome.DEPLOYED] * 2, "succeeded"),
        ("tree", [Outcome.DEPLOYED, Outcome.SKIPPED], "partial"),
        ("tree", [Outcome.FAILED, Outcome.SKIPPED], "failed"),
        ("time_limit", [Outcome.DEPLOYED, None], "partial"),
        ("crash", [Outcome.DEPLOYED] * 2, "failed"),
        ("aborted", [Outcome.DEPLOYED] * 2, "aborted"),
    ],
)
def test_the_status_follows_from_the_ledger(ended_by: str, outcomes: list[Outcome], status: str) -> None:
    assert status_of(Finding(ended_by=ended_by), outcomes) == status


def test_without_plants_the_tree_decides() -> None:
    assert status_of(Finding(succeeded=True), []) == "succeeded"
    assert status_of(Finding(succeeded=False), []) == "failed"


def test_an_empty_feeder_is_the_reason_of_what_was_not_served(make_runner: Make) -> None:
    def script(context: Context, ticks: int) -> Status:
        for _ in range(8):
            context.ledger.move_dispenser("feeder", "hand")
            context.ledger.move_dispenser("hand", "lost")
        return Status.SUCCEEDED

    runner, _ = make_runner(script)
    runner.run()
    assert {task.reason for task in runner.ledger.plants()} == {"feeder_empty"}


def test_the_mission_starts_and_ends_in_the_events(make_runner: Make) -> None:
    runner, _ = make_runner(end_at(2))
    runner.run()
    kinds = [event["kind"] for event in read_events(runner.log._folder / "events.jsonl")]
    assert (kinds[0], kinds[-1]) == ("mission_started", "mission_ended")
