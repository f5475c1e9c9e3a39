"""Which missions a campaign runs: seeds, settings, and keys that take one value after the other."""

from __future__ import annotations

import itertools
import json
import math
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grape.errors import InvalidInput
from grape.mission.file import Mission, load_mission, mission_path
from grape.mission.record import read_json, write_atomic
from grape.mission.result_file import read_result

PLAN_FILE = "plan.json"
MOST_COMBINATIONS = 10_000
CODE = "from grape.cli import main; main()"


@dataclass(frozen=True, kw_only=True)
class Variation:
    """A key of the mission file and the values that it takes in turn."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is the same for all missions of a campaign folder.

    Attributes:
        mission: as the user named it.
        settings: `KEY=VALUE` of every mission.
        variations: with several, every combination has its turn.
    """

    mission: str
    settings: tuple[str, ...] = ()
    variations: tuple[Variation, ...] = ()

    def combinations(self) -> list[tuple[str, ...]]:
        """The settings of each combination of varied values, `KEY=VALUE`."""
        choices = [[f"{variation.key}={value}" for value in variation.values] for variation in self.variations]
        return list(itertools.product(*choices))

    def varied(self, seed: int) -> tuple[str, ...]:
        """The varied settings of a seed: combinations go round, so that a seed always means the same mission."""
        combinations = self.combinations()
        return combinations[seed % len(combinations)]

    def check(self, seed: int) -> Mission:
        """Load the mission in every combination, and return the first.

        Raises:
            FileError: one of them has problems.
        """
        loaded = [
            load_mission(self.mission, [*self.settings, *settings, f"seed={seed}"]) for settings in self.combinations()
        ]
        return loaded[0]

    def as_dict(self) -> dict[str, Any]:
        """As plan.json has it."""
        vary = {variation.key: list(variation.values) for variation in self.variations}
        return {"mission": self.mission, "set": list(self.settings), "vary": vary}


@dataclass(frozen=True, kw_only=True)
class Job:
    """One mission of a campaign.

    Attributes:
        settings: every `KEY=VALUE`, the varied ones included.
        varied: the varied values by key, as text.
        folder: its run folder.
        command: what a process runs.
        replay: the same for a person to type.
    """

    seed: int
    settings: tuple[str, ...]
    varied: dict[str, str]
    folder: Path
    command: tuple[str, ...]
    replay: str

    @property
    def log(self) -> Path:
        """What the process printed."""
        return self.folder.with_suffix(".log")

    def result(self) -> dict[str, Any] | None:
        """Its result.json once it is finished; None before, also when somebody stopped it.

        Raises:
            FileError: it is damaged.
        """
        path = self.folder / "result.json"
        if not path.is_file():
            return None
        result = read_result(path)
        return None if result["status"] == "aborted" else result


def parse_variation(text: str) -> Variation:
    """`KEY=A,B,C` as a user writes it.

    Raises:
        InvalidInput: it is not a key and at least one value, or a value stands there twice.
    """
    key, _, values = text.partition("=")
    parts = tuple(part.strip() for part in values.split(","))
    if not key or not all(parts):
        raise InvalidInput(f"--vary must be KEY=A,B,…, like world.style=cordon,gobelet; got {text!r}")
    if len(set(parts)) != len(parts):
        raise InvalidInput(f"--vary {text}: a value is given twice")
    return Variation(key=key.strip(), values=parts)


def make_plan(mission: str, settings: Iterable[str], variations: Iterable[str]) -> Plan:
    """The plan of a command line.

    Raises:
        InvalidInput: a variation is malformed, a key is given twice, or the combinations are too many.
    """
    parsed = tuple(parse_variation(text) for text in variations)
    fixed = [text.partition("=")[0] for text in settings]
    seen: set[str] = set()
    for key in [*fixed, *(variation.key for variation in parsed)]:
        if key == "seed" or key in seen:
            raise InvalidInput(f"{key}: " + ("seeds come from --seeds" if key == "seed" else "it is given twice"))
        seen.add(key)
    combinations = math.prod(len(variation.values) for variation in parsed)
    if combinations > MOST_COMBINATIONS:
        raise InvalidInput(f"--vary: {combinations} combinations; allowed: at most {MOST_COMBINATIONS}")
    return Plan(mission=mission, settings=tuple(settings), variations=parsed)


def make_jobs(plan: Plan, seeds: Sequence[int], folder: Path) -> list[Job]:
    """One job a seed, in folders below `folder`."""
    path = mission_path(plan.mission)
    named = plan.mission if Path(plan.mission) != path else str(path.resolve())
    jobs = []
    for seed in seeds:
        varied = plan.varied(seed)
        settings = (*plan.settings, *varied)
        run = folder / f"seed{seed}"
        assignments = [word for setting in settings for word in ("--set", setting)]
        tail = ["--seed", str(seed), *assignments]
        jobs.append(
            Job(
                seed=seed,
                settings=settings,
                varied=dict(text.split("=", 1) for text in varied),
                folder=run,
                command=(sys.executable, "-c", CODE, "run", named, *tail, "--out", str(run.resolve())),
                replay=shlex.join(["grape", "run", plan.mission, *tail]),
            )
        )
    return jobs


def keep_plan(plan: Plan, folder: Path) -> None:
    """Write plan.json, or refuse a folder whose missions are others.

    Raises:
        InvalidInput: the folder holds another campaign, or something else.
    """
    path = folder / PLAN_FILE
    if path.is_file():
        known = read_json(path)
        if known != plan.as_dict():
            differing = [key for key in plan.as_dict() if known.get(key) != plan.as_dict()[key]]
            what = "; ".join(f"{key}: there {known.get(key)}, here {plan.as_dict()[key]}" for key in differing)
            raise InvalidInput(f"--out {folder} holds another campaign ({what}); name a new folder")
    elif any(folder.iterdir()):
        raise InvalidInput(f"--out {folder}: it is not empty and holds no campaign; name a new folder")
    write_atomic(path, json.dumps(plan.as_dict(), indent=2, ensure_ascii=False) + "\n")
