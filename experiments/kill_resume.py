"""K1: missions are killed at random instants and resumed, and the robot's account is held against the referee's."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grape.campaign.engines import ONE_THREAD
from grape.mission.command import Cancellation
from grape.mission.record import read_events, write_atomic
from grape.mission.result import misplaced, true_places
from grape.navigation.route import park_beside
from grape.proof import Experiment, Proof, Quantity, wilson95
from grape.sim.checkpoint import JOURNAL_FILE, kept_time
from grape.sim.worlds import VineyardOptions, vineyard_site
from grape.site import save_site

KILLS = 25  # of one mission at most
GAP_S = 20.0  # simulated, mean: a kill is equally likely at every instant of a session
DISPENSERS = 3
PATIENCE_S = 900.0  # of the wall clock for one session
PLANTS = "plants=[{plant: r0n0, mode: nail}, {plant: r0v1, mode: plant}]"
SETTINGS = ("world.rows=1", "world.vines_per_row=2", "arm_errors=1", f"dispensers={DISPENSERS}")


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """One mission a seed, on a nail and a vine near the start, killed again and again; what is done is read.

    When it is asked to stop, the figures are of what was done so far, kills of an unfinished mission included.
    """
    cancellation = Cancellation()
    with cancellation.listening():
        for k, seed in enumerate(seeds):
            if not (folder / f"trial{seed}.json").exists() and not cancellation():
                found = trial(
                    seed,
                    folder / f"seed{seed}",
                    cancellation,
                    lambda sentence, k=k, seed=seed: progress(k / len(seeds), f"seed {seed}: {sentence}"),  # type: ignore[misc]
                )
                if found["ended"] or not cancellation():
                    write_atomic(folder / f"trial{seed}.json", json.dumps(found, indent=2) + "\n")
    return replace(
        summary([_read(seed, folder) for seed in seeds if _begun(seed, folder)]), complete=not cancellation()
    )


def _begun(seed: int, folder: Path) -> bool:
    return (folder / f"trial{seed}.json").exists() or (folder / f"seed{seed}.kills.json").exists()


def _read(seed: int, folder: Path) -> dict[str, Any]:
    """A trial that is done, or what there is of one that was stopped."""
    path, run_folder = folder / f"trial{seed}.json", folder / f"seed{seed}"
    if path.exists():
        done: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return done
    return {"seed": seed, "ended": False, "stopped": True, "kills": _kills(run_folder)}


def _kills(folder: Path) -> list[dict[str, Any]]:
    """The kills of a mission so far, each with what the robot's first look after it came to."""
    path = folder.with_suffix(".kills.json")
    kills = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return judged_kills(kills, list(read_events(folder / "events.jsonl")) if kills else [], _journal(folder))


def trial(
    seed: int,
    folder: Path,
    cancelled: Callable[[], bool] = lambda: False,
    progress: Callable[[str], None] = lambda sentence: None,
) -> dict[str, Any]:
    """Run, kill and resume one mission until it ends by itself; what it came to."""
    site, noted = folder.with_suffix(".geojson"), folder.with_suffix(".kills.json")
    kills: list[dict[str, Any]] = json.loads(noted.read_text(encoding="utf-8")) if noted.exists() else []
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        _site_near_the_plants(site)
        settings = [*SETTINGS, PLANTS, f"site={site.resolve()}", f"seed={seed}"]
        command = ["run", "--out", str(folder), *(f"--set={setting}" for setting in settings)]
    else:
        command = ["resume", str(folder)]
    while not cancelled():
        rng = np.random.default_rng([seed, 11, len(kills)])
        gap_s = float(rng.exponential(GAP_S)) if len(kills) < KILLS else None
        killed_at = _session(command, folder, gap_s, rng, cancelled)
        if killed_at is None:
            break
        command = ["resume", str(folder)]
        if cancelled():  # that was no random instant
            break
        kills.append({"t": killed_at, "action": _action_at_kill(folder)})
        write_atomic(noted, json.dumps(kills) + "\n")
        progress(f"{len(kills)} kills, the last at {killed_at:.1f} s during {kills[-1]['action']}")
    result_file = folder / "result.json"
    if not result_file.exists():
        return {"seed": seed, "kills": _kills(folder), "ended": False}
    result = json.loads(result_file.read_text(encoding="utf-8"))
    events = list(read_events(folder / "events.jsonl"))
    return {
        "seed": seed,
        "kills": judged_kills(kills, events, result["truth"]["checks"]),
        "ended": True,
        **judged(result, events),
    }


def judged(result: dict[str, Any], events: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The robot's account of a finished mission beside the referee's, place by place.

    Returns:
        `account` and `truth` (feeder, hand, lost, plants' ids), `equal`, `misplaced` dispensers, `repeated` plants.
    """
    account, seen = result["places"], true_places(result["truth"])
    deployed = {plant["id"] for plant in result["plants"] if plant["outcome"] == "deployed"}
    wrong = sum(misplaced(account, seen).values())
    return {
        "status": result["status"],
        "account": {place: number for place, number in account.items() if number},
        "truth": {place: number for place, number in seen.items() if number},
        "equal": wrong == 0 and deployed == set(result["truth"]["hanging"]),
        "misplaced": wrong,
        "repeated": sorted({plant for plant, _ in repeats(events)}),
        "plants": [[plant["id"], plant["outcome"], plant["reason"]] for plant in result["plants"]],
    }


def judged_kills(
    kills: Sequence[dict[str, Any]], events: Sequence[dict[str, Any]], witnessed: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Each kill with `settled_s`, `equal` and `repeated`: what came of it until the next.

    `equal` says whether, right after the robot had settled its account, it had everything where it was; a dispenser
    that is missing in the feeder is told by the next look there, so feeder and lost count together. It is None when
    the robot did not get as far.

    Args:
        witnessed: what the referee has noted, as `truth.checks` of the result has it.
    """
    noted = {round(w["time_s"], 2): true_places(w) for w in witnessed if w["check"] == "settled"}
    settled = [event for event in events if event["kind"] == "settled" and round(event["t"], 2) in noted]
    found = []
    ends = [*(kill["t"] for kill in kills), float("inf")]
    for kill, later in zip(kills, ends[1:], strict=True):
        event = next((event for event in settled if event["t"] > kill["t"]), None)
        again = sorted({plant for plant, t in repeats(events) if kill["t"] < t <= later})
        equal = None if event is None else _as_settled(event["places"]) == _as_settled(noted[round(event["t"], 2)])
        found.append({**kill, "settled_s": event and event["t"], "equal": equal, "repeated": again})
    return found


def _as_settled(places: Mapping[str, int]) -> dict[str, int]:
    """Dispensers by place, what is 0 left out, feeder and lost as one."""
    joined = {place: number for place, number in places.items() if place not in ("feeder", "lost") and number}
    return joined | {"feeder or lost": places.get("feeder", 0) + places.get("lost", 0)}


def repeats(events: Sequence[dict[str, Any]]) -> list[tuple[str, float]]:
    """Plants that were begun again after their end, and when."""
    found, finished = [], set()
    for event in events:
        if event["kind"] == "plant_finished":
            finished.add(event["plant"])
        elif event["kind"] == "plant_started" and event["plant"] in finished:
            found.append((str(event["plant"]), float(event["t"])))
    return found


def _journal(folder: Path) -> list[dict[str, Any]]:
    """What the referee of a mission that has not ended has noted so far."""
    path = folder / "world" / JOURNAL_FILE
    lines = read_events(path) if path.exists() else ()
    return [entry for entry in lines if entry.get("kind") == "Witness"]


def summary(trials: Sequence[dict[str, Any]]) -> Proof:
    """The figures of trials; one that was stopped counts with its kills alone."""
    whole = [trial for trial in trials if not trial.get("stopped")]
    ended = [trial for trial in whole if trial["ended"]]
    kills = [kill for trial in trials for kill in trial["kills"]]
    settled = [kill for kill in kills if kill["equal"] is not None]
    equal, right, n = sum(trial["equal"] for trial in ended), sum(kill["equal"] for kill in settled), len(whole)
    plants = [plant for trial in ended for plant in trial["plants"]]
    deployed = sum(outcome == "deployed" for _, outcome, _ in plants)
    quantities = (
        Quantity(name="kills", unit="1", value=len(kills), n=len(trials), goal=">= 50"),
        Quantity(
            name="resumed missions whose account equals the referee's", unit="1", value=equal / n if n else None, n=n,
            ci95=wilson95(equal, n), goal=">= 1",
        ),
        Quantity(
            name="kills after which the settled account equals the referee's", unit="1",
            value=right / len(settled) if settled else None, n=len(settled), ci95=wilson95(right, len(settled)),
            goal=">= 1",
        ),
        Quantity(
            name="plants served twice", unit="1", value=sum(len(kill["repeated"]) for kill in kills), n=len(kills),
            goal="<= 0",
        ),
        Quantity(
            name="dispensers in a wrong place of the account", unit="1", value=sum(t["misplaced"] for t in ended),
            n=len(ended) * DISPENSERS, goal="<= 0",
        ),
        Quantity(
            name="plants deployed though killed", unit="1", value=deployed / len(plants) if plants else None,
            n=len(plants), ci95=wilson95(deployed, len(plants)),
        ),
    )  # fmt: skip
    return Proof(quantities=quantities, notes=_notes(trials, kills))


def _notes(trials: Sequence[dict[str, Any]], kills: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    during = Counter(kill["action"] for kill in kills)
    stopped = [str(trial["seed"]) for trial in trials if trial.get("stopped")]
    unequal = [str(t["seed"]) for t in trials if not t.get("stopped") and not (t["ended"] and t["equal"])]
    return (
        "Each mission is a nail and a vine near the start, the arm as flawed as a real one; SIGKILL hits the process at"
        f" every simulated instant with the same chance, every {GAP_S:g} s on average, at most {KILLS} times.",
        "Killed during: " + ", ".join(f"{name} {count}" for name, count in during.most_common()),
        "Seeds whose account differs or that did not end: " + (", ".join(unequal) or "none"),
        *(f"Kills of seed {t['seed']}: " + "; ".join(map(_told, t["kills"])) for t in trials if t["kills"]),
        *((f"Stopped before its end, counted with its kills alone: seed {', '.join(stopped)}",) if stopped else ()),
    )


def _told(kill: dict[str, Any]) -> str:
    """One kill for a person."""
    account = {True: "account right", False: "ACCOUNT WRONG", None: "not settled yet"}[kill["equal"]]
    again = f", SERVED AGAIN: {', '.join(kill['repeated'])}" if kill["repeated"] else ""
    return f"{kill['t']:.1f} s {kill['action']}, {account}{again}"


def _site_near_the_plants(path: Path) -> None:
    """A short row whose start is 0.75 m before the stop beside the nail."""
    site = vineyard_site(VineyardOptions(rows=1, vines_per_row=2))
    x, y, yaw = park_beside(site, "r0n0", "fore")
    save_site(replace(site, start=np.array([x - 0.75, y - 0.1]), start_heading_rad=yaw), path)


def _session(
    command: list[str], folder: Path, gap_s: float | None, rng: np.random.Generator, cancelled: Callable[[], bool]
) -> float | None:
    """Run `grape` until it ends, or kill it `gap_s` simulated seconds after its start, or when somebody cancels.

    Returns:
        Simulated time of the kill; None when the program has ended by itself.
    """
    begin = kept_time(folder / "world") or 0.0
    with folder.with_suffix(".log").open("a", encoding="utf-8") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", "from grape.cli import main; main()", *command], stdout=log, stderr=log,
            env={"MUJOCO_GL": "egl", **os.environ, **ONE_THREAD}, start_new_session=True,
        )  # fmt: skip
        give_up = time.monotonic() + PATIENCE_S
        while process.poll() is None:
            now = kept_time(folder / "world") or 0.0
            due = gap_s is not None and now >= begin + gap_s
            if due or cancelled() or time.monotonic() > give_up:
                time.sleep(float(rng.uniform(0.0, 0.05)))
                process.send_signal(signal.SIGKILL)
                process.wait()
                return kept_time(folder / "world")
            time.sleep(0.01)
    return None


def _action_at_kill(folder: Path) -> str:
    """The newest action that was running."""
    action = "start"
    path = folder / "events.jsonl"
    for event in read_events(path) if path.exists() else ():
        if event["kind"] == "mission_resumed":
            action = "localising"
        elif event["kind"] == "action":
            action = str(event["name"]) if event["status"] == "active" else f"after {event['name']}"
    return action


EXPERIMENT = Experiment(
    row="K1",
    summary="Missions are killed at random instants and resumed; the account is held against the referee's.",
    seeds=range(500, 506),
    run=run,
)
