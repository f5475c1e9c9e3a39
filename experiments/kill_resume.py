"""K1: missions are killed at random instants and resumed, and the robot's account is held against the referee's."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grape.mission.record import read_events, write_atomic
from grape.navigation.route import park_beside
from grape.proof import Experiment, Proof, Quantity, wilson95
from grape.sim.checkpoint import kept_time
from grape.sim.worlds import VineyardOptions, vineyard_site
from grape.site import save_site

KILLS = 6  # of one mission at most
GAP_S = (2.0, 32.0)  # simulated between the start of a session and its kill
DISPENSERS = 4
PATIENCE_S = 900.0  # of the wall clock for one session
PLANTS = "plants=[{plant: r0n0, mode: nail}, {plant: r0v1, mode: plant}]"


def run(seeds: Sequence[int], folder: Path, progress: Callable[[float, str], None]) -> Proof:
    """One mission a seed, on a nail and a vine near the start, killed up to six times; seeds that are done are read."""
    trials = []
    for k, seed in enumerate(seeds):
        path = folder / f"trial{seed}.json"
        if not path.exists():
            progress(k / len(seeds), f"seed {seed}")
            write_atomic(path, json.dumps(trial(seed, folder / f"seed{seed}"), indent=2) + "\n")
        trials.append(json.loads(path.read_text(encoding="utf-8")))
    return summary(trials)


def trial(seed: int, folder: Path) -> dict[str, Any]:
    """Run, kill and resume one mission until it ends by itself; what it came to."""
    site, noted = folder.with_suffix(".geojson"), folder.with_suffix(".kills.json")
    kills: list[dict[str, Any]] = json.loads(noted.read_text(encoding="utf-8")) if noted.exists() else []
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        _site_near_the_plants(site)
        settings = ["world.rows=1", "world.vines_per_row=2", PLANTS, f"site={site.resolve()}", f"seed={seed}"]
        command = ["run", "--out", str(folder), *(f"--set={s}" for s in [*settings, f"dispensers={DISPENSERS}"])]
    else:
        command = ["resume", str(folder)]
    while True:
        rng = np.random.default_rng([seed, 11, len(kills)])
        gap_s = float(rng.uniform(*GAP_S)) if len(kills) < KILLS else None
        killed_at = _session(command, folder, gap_s, rng)
        if killed_at is None:
            break
        kills.append({"t": killed_at, "action": _action_at_kill(folder)})
        write_atomic(noted, json.dumps(kills) + "\n")
        command = ["resume", str(folder)]
    result_file = folder / "result.json"
    if not result_file.exists():
        return {"seed": seed, "kills": kills, "ended": False}
    result = json.loads(result_file.read_text(encoding="utf-8"))
    return {"seed": seed, "kills": kills, "ended": True, **judged(result, list(read_events(folder / "events.jsonl")))}


def judged(result: dict[str, Any], events: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The robot's account of a finished mission beside the referee's.

    Returns:
        `account` and `truth` (deployed, left, lost, on_hand), `equal`, `misplaced` dispensers, `repeated` plants.
    """
    account, truth = dict(result["dispensers"]), result["truth"]
    loaded = account.pop("loaded")
    elsewhere = truth["in_feeder"] + truth["dropped"] + truth["on_hand"]
    seen = {
        "deployed": loaded - elsewhere, "left": truth["in_feeder"], "lost": truth["dropped"],
        "on_hand": truth["on_hand"],
    }  # fmt: skip
    deployed = {plant["id"] for plant in result["plants"] if plant["outcome"] == "deployed"}
    repeated, finished = set(), set()
    for event in events:
        if event["kind"] == "plant_finished":
            finished.add(event["plant"])
        elif event["kind"] == "plant_started" and event["plant"] in finished:
            repeated.add(event["plant"])
    return {
        "status": result["status"],
        "account": account,
        "truth": seen,
        "equal": account == seen and deployed == set(truth["hanging"]),
        "misplaced": sum(abs(account[key] - seen[key]) for key in seen) / 2,
        "repeated": sorted(repeated),
        "plants": [[plant["id"], plant["outcome"], plant["reason"]] for plant in result["plants"]],
    }


def summary(trials: Sequence[dict[str, Any]]) -> Proof:
    """The figures of finished trials."""
    ended = [trial for trial in trials if trial["ended"]]
    kills = [kill for trial in trials for kill in trial["kills"]]
    equal = sum(trial["equal"] for trial in ended)
    n = len(trials)
    plants = [plant for trial in ended for plant in trial["plants"]]
    deployed = sum(outcome == "deployed" for _, outcome, _ in plants)
    quantities = (
        Quantity(name="kills", unit="1", value=len(kills), n=n, goal=">= 50"),
        Quantity(
            name="resumed missions whose account equals the referee's", unit="1", value=equal / n if n else None, n=n,
            ci95=wilson95(equal, n), goal=">= 1",
        ),
        Quantity(name="plants served twice", unit="1", value=sum(len(t["repeated"]) for t in ended), n=n, goal="<= 0"),
        Quantity(
            name="dispensers in a wrong place of the account", unit="1", value=sum(t["misplaced"] for t in ended),
            n=n * DISPENSERS, goal="<= 0",
        ),
        Quantity(
            name="plants deployed though killed", unit="1", value=deployed / len(plants) if plants else None,
            n=len(plants), ci95=wilson95(deployed, len(plants)),
        ),
    )  # fmt: skip
    during = Counter(kill["action"] for kill in kills)
    unequal = [str(trial["seed"]) for trial in trials if not (trial["ended"] and trial["equal"])]
    notes = (
        "Each mission is a nail and a vine near the start; SIGKILL hits the process at a random simulated instant,"
        f" {GAP_S[0]:g} to {GAP_S[1]:g} s after each start of a session, at most {KILLS} times.",
        "Killed during: " + ", ".join(f"{name} {count}" for name, count in during.most_common()),
        "Seeds whose account differs or that did not end: " + (", ".join(unequal) or "none"),
    )
    return Proof(quantities=quantities, notes=notes)


def _site_near_the_plants(path: Path) -> None:
    """A short row whose start is 0.75 m before the stop beside the nail."""
    site = vineyard_site(VineyardOptions(rows=1, vines_per_row=2))
    x, y, yaw = park_beside(site, "r0n0", "fore")
    save_site(replace(site, start=np.array([x - 0.75, y - 0.1]), start_heading_rad=yaw), path)


def _session(command: list[str], folder: Path, gap_s: float | None, rng: np.random.Generator) -> float | None:
    """Run `grape` until it ends, or kill it `gap_s` simulated seconds after its start.

    Returns:
        Simulated time of the kill; None when the program has ended by itself.
    """
    begin = kept_time(folder / "world") or 0.0
    with folder.with_suffix(".log").open("a", encoding="utf-8") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", "from grape.cli import main; main()", *command], stdout=log, stderr=log
        )
        give_up = time.monotonic() + PATIENCE_S
        while process.poll() is None:
            now = kept_time(folder / "world") or 0.0
            if (gap_s is not None and now >= begin + gap_s) or time.monotonic() > give_up:
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
    seeds=range(500, 510),
    run=run,
)
