"""Processes of this machine, and tasks of a Ray cluster (a made-up one)."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from grape.campaign.engines import EngineError, LocalEngine, RayEngine, engine_named
from grape.campaign.plan import Job, make_jobs, make_plan
from grape.mission.lock import LOCK_FILE, FolderBusy, RunLock


def job_that(folder: Path, code: str) -> Job:
    """A job whose process runs this Python."""
    (job,) = make_jobs(make_plan("dispenser_deployment", [], []), range(1), folder)
    return replace(job, command=(sys.executable, "-c", code))


def wait(engine: Any, job: Job) -> None:
    for _ in range(200):
        if engine.ended() == [job]:
            return
        time.sleep(0.02)
    raise AssertionError("the job did not end")


def test_a_job_runs_in_a_process_of_one_thread_and_an_empty_folder(folder: Path) -> None:
    job = job_that(folder, "import os, sys; print(os.environ['OMP_NUM_THREADS']); sys.exit(3)")
    job.folder.mkdir()
    (job.folder / "half_a_result").touch()
    engine = LocalEngine()
    engine.start(job)
    wait(engine, job)
    assert engine.ended() == []
    assert job.log.read_text() == "1\n" and not job.folder.exists()


def test_a_folder_in_which_a_mission_still_runs_is_left_alone(folder: Path) -> None:
    job = job_that(folder, "pass")
    job.folder.mkdir()
    with RunLock(job.folder), pytest.raises(FolderBusy, match="another process"):
        LocalEngine().start(job)
    assert (job.folder / LOCK_FILE).exists()


def test_stopping_ends_the_processes(folder: Path) -> None:
    job = job_that(folder, "import signal, sys, time\nsignal.signal(15, lambda *a: sys.exit(print('asked')))\n"
                           "print('up', flush=True)\ntime.sleep(60)")  # fmt: skip
    engine = LocalEngine()
    engine.start(job)
    for _ in range(200):
        if job.log.read_text() == "up\n":
            break
        time.sleep(0.02)
    engine.stop()
    assert job.log.read_text() == "up\nasked\n"
    assert engine.ended() == []


class PaperRay(SimpleNamespace):
    """As much of Ray as the engine uses; a task runs when somebody waits for it."""

    def __init__(self) -> None:
        super().__init__(calls=[], tasks={})

    def init(self, **options: Any) -> None:
        self.calls.append("init")

    def remote(self, **options: Any) -> Any:
        def wrap(function: Any) -> Any:
            def submit(job: Job) -> int:
                self.tasks[len(self.tasks)] = (function, job)
                return len(self.tasks) - 1

            return SimpleNamespace(remote=submit)

        return wrap

    def wait(self, references: list[int], num_returns: int, timeout: float) -> tuple[list[int], list[int]]:
        function, job = self.tasks[references[0]]
        function(job)
        return references[:1], references[1:]

    def cancel(self, reference: int) -> None:
        self.calls.append(("cancel", reference))

    def shutdown(self) -> None:
        self.calls.append("shutdown")


def test_the_ray_engine_runs_a_job_as_a_task(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ray = PaperRay()
    monkeypatch.setitem(sys.modules, "ray", ray)
    engine = RayEngine()
    assert engine.ended() == []
    job = job_that(folder, "print('done')")
    engine.start(job)
    assert engine.ended() == [job]
    assert job.log.read_text() == "done\n"
    engine.start(job)
    engine.stop()
    assert ray.calls == ["init", ("cancel", 1), "shutdown"]


def test_without_ray_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(EngineError, match=r"pip install grape\[ray\]"):
        engine_named("ray")
    assert engine_named("local") is LocalEngine
