"""The default mission on many seeds: what hangs, whether the robot's account agrees, forces, times.

    python benchmarks/missions.py --seeds 0:10 --workers 2 --out runs/seeds
    python benchmarks/missions.py --seeds 0:10 --out runs/gobelet --set world.style=gobelet

Each seed is one `grape run` in a folder of its own; a run that is there already is only read.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from grape.proof import wilson95


def run(seed: int, out: Path, settings: list[str]) -> Path:
    """One mission; returns its run folder."""
    folder = out / f"seed{seed}"
    if not (folder / "result.json").exists():
        command = ["grape", "run", "--seed", str(seed), "--out", str(folder)]
        for setting in settings:
            command += ["--set", setting]
        with (out / f"seed{seed}.log").open("w") as log:
            subprocess.run(command, stdout=log, stderr=log, check=False)  # partial and failed missions count too
    return folder


def summary(folders: list[Path]) -> dict[str, object]:
    """The figures of finished runs."""
    results = [json.loads((folder / "result.json").read_text()) for folder in folders]
    plants = [
        (plant, result["truth"]["plants"][plant["id"]]["hanging"]) for result in results for plant in result["plants"]
    ]
    hanging = sum(hangs for _, hangs in plants)
    agreeing = sum((plant["outcome"] == "deployed") == hangs for plant, hangs in plants)
    cycles = [plant["cycle_s"] for plant, _ in plants if plant["cycle_s"]]
    rmse = [result["localization"]["position_rmse_m"] for result in results]
    return {
        "missions": len(results),
        "ended_by_themselves": sum(result["ended_by"] == "tree" for result in results),
        "plants": len(plants),
        "hanging": hanging,
        "hanging_wilson95": [round(v, 3) for v in wilson95(hanging, len(plants))],
        "account_agrees": agreeing,
        "account_wilson95": [round(v, 3) for v in wilson95(agreeing, len(plants))],
        "fence_crossings": sum(result["truth"]["fence_crossings"] for result in results),
        "max_plant_force_n": max(result["truth"]["max_plant_force_n"] for result in results),
        "cycle_s_median": statistics.median(cycles) if cycles else None,
        "position_rmse_m_median": statistics.median(rmse),
        "position_rmse_m_max": max(rmse),
        "real_time_factor_median": statistics.median(result["real_time_factor"] for result in results),
        "failures": [
            f"seed {result['seed']} {plant['id']} {plant['mode']}: {plant['outcome']} {plant['reason']}"
            for result in results
            for plant in result["plants"]
            if plant["outcome"] != "deployed"
        ],
    }


def main() -> int:
    """Runs and prints; exit code 1 when a run left no result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:10", help="first:last, last excluded")
    parser.add_argument("--workers", type=int, default=1, help="missions at the same time")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    arguments = parser.parse_args()
    first, last = (int(part) for part in arguments.seeds.split(":"))
    arguments.out.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(arguments.workers) as pool:
        folders = list(pool.map(lambda seed: run(seed, arguments.out, arguments.settings), range(first, last)))
    finished = [folder for folder in folders if (folder / "result.json").exists()]
    if finished:
        print(json.dumps(summary(finished), indent=2))
    for folder in folders:
        if folder not in finished:
            print(f"{folder}: no result, see {folder}.log", file=sys.stderr)
    return 0 if len(finished) == len(folders) else 1


if __name__ == "__main__":
    raise SystemExit(main())
