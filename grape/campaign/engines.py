"""Where the missions of a campaign run: in processes of this machine, or on a Ray cluster."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Protocol

from grape.campaign.plan import Job
from grape.errors import GrapeError, with_suggestion
from grape.mission.lock import RunLock

STOP_S = 20.0
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


class EngineError(GrapeError):
    """An engine cannot be used."""


class Engine(Protocol):
    """Runs jobs."""

    def start(self, job: Job) -> None:
        """Begin a job in an empty folder."""
        ...

    def ended(self) -> list[Job]:
        """Jobs that ended since the last call, whatever they came to."""
        ...

    def stop(self) -> None:
        """End everything that runs, and wait for it."""
        ...


def launch(job: Job) -> subprocess.Popen[bytes]:
    """The process of a job; what an earlier one left in its folder is thrown away.

    Raises:
        FolderBusy: a mission of a campaign that was killed is still at it.
    """
    if job.folder.exists():
        with RunLock(job.folder):
            shutil.rmtree(job.folder)
    with job.log.open("wb") as log:
        environment = {"MUJOCO_GL": "egl", **os.environ, **ONE_THREAD}
        # A session of its own: Ctrl-C reaches the campaign alone, and that ends its missions.
        return subprocess.Popen(
            job.command, stdout=log, stderr=subprocess.STDOUT, env=environment, start_new_session=True
        )


def end(process: subprocess.Popen[bytes]) -> None:
    """Ask a process to stop, and kill it when it does not."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class LocalEngine:
    """Processes of this machine, one thread each."""

    def __init__(self) -> None:
        self._running: list[tuple[Job, subprocess.Popen[bytes]]] = []

    def start(self, job: Job) -> None:
        self._running.append((job, launch(job)))

    def ended(self) -> list[Job]:
        done = [job for job, process in self._running if process.poll() is not None]
        self._running = [(job, process) for job, process in self._running if job not in done]
        return done

    def stop(self) -> None:
        for _, process in self._running:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for _, process in self._running:
            end(process)
        self._running = []


def run_to_its_end(job: Job) -> None:
    """A job as a task of another program: when the task is cancelled, the process ends too."""
    process = launch(job)
    try:
        process.wait()
    finally:
        end(process)


class RayEngine:
    """Tasks of a Ray cluster (`RAY_ADDRESS`; without it, one on this machine).

    grape must be installed on every node, and the campaign folder must be one that all of them share.
    """

    def __init__(self) -> None:
        import ray

        self._ray: Any = ray
        ray.init(ignore_reinit_error=True, log_to_driver=False, include_dashboard=False)
        self._task = ray.remote(num_cpus=1, max_retries=0)(run_to_its_end)
        self._running: dict[Any, Job] = {}

    def start(self, job: Job) -> None:
        self._running[self._task.remote(job)] = job

    def ended(self) -> list[Job]:
        if not self._running:
            return []
        done, _ = self._ray.wait(list(self._running), num_returns=len(self._running), timeout=0)
        return [self._running.pop(reference) for reference in done]

    def stop(self) -> None:
        for reference in self._running:
            self._ray.cancel(reference)
        if self._running:
            self._ray.wait(list(self._running), num_returns=len(self._running), timeout=STOP_S)
        self._running = {}
        self._ray.shutdown()


ENGINES: Mapping[str, Callable[[], Engine]] = MappingProxyType({"local": LocalEngine, "ray": RayEngine})


def engine_named(name: str) -> Callable[[], Engine]:
    """What makes the engine of this name.

    Raises:
        EngineError: there is none, or what it needs is not installed.
    """
    if name not in ENGINES:
        raise EngineError(with_suggestion(f"--engine {name}: there are {', '.join(ENGINES)}", name, ENGINES))
    if name == "ray" and importlib.util.find_spec("ray") is None:
        raise EngineError("--engine ray needs Ray; install it with: pip install grape[ray]")
    return ENGINES[name]
