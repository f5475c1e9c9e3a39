"""`grape filter`: a log and a configuration in, the estimate out."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from grape.errors import FileError, GrapeError, Problem
from grape.folders import refuse_unwritable_file
from grape.geometry import rotation_to_rpy
from grape.localization.filter_file import ConfiguredFilter, load_filter
from grape.localization.filter_log import STDS, FilterLog
from grape.localization.fusion import Fusion
from grape.localization.readings import Reading
from grape.localization.state import STATE

POSE_NAMES = STATE[:6]
MAP_ODOM = tuple(f"map_odom_{name}" for name in POSE_NAMES)
GEODETIC = ("lat", "lon", "alt")


def filter_command(log: Path, config: Path, out: Path | None, overrides: Iterable[str] = ()) -> list[str]:
    """Filter a log, write the estimate, and say in lines what came out.

    Raises:
        FileError: the log or the configuration has problems; then nothing is written.
        InvalidInput: the estimate cannot be written.
        GrapeError: the filter never began.
    """
    configured = load_filter(config, overrides)
    out = out or log.with_suffix(".estimate.csv")
    if out.suffix not in (".csv", ".jsonl"):
        raise FileError([Problem(file=str(out), got=f"ends with {out.suffix!r}", allowed=".csv or .jsonl")])
    refuse_unwritable_file("--out", out)
    readings = FilterLog(log, configured.tracks, configured.file.ignore).readings()
    part = out.with_name(out.name + ".part")
    try:
        with part.open("w", encoding="utf-8", newline="") as stream:
            rows = _write(stream, estimates(configured, readings), json_lines=out.suffix == ".jsonl")
        if not rows:
            missing = ", ".join(configured.fusion.waiting_for) or "a usable reading"
            raise GrapeError(
                f"{log}: no estimate: the filter still waits for {missing}; refused: {_counts(configured)}"
            )
        part.replace(out)
    except OSError as error:
        raise FileError([Problem(file=str(out), got=f"cannot be written: {error.strerror or error}")]) from error
    finally:
        part.unlink(missing_ok=True)
    return [f"{out}: {rows} estimates", *_account(configured)]


def estimates(configured: ConfiguredFilter, readings: Iterable[Reading]) -> Iterator[dict[str, float]]:
    """Rows of the estimate on a grid of times, each knowing only what had come by then; one more for the last time."""
    period, taker = 1.0 / configured.file.rate, configured.cascade or configured.fusion
    fusion, longest = configured.fusion, configured.fusion.options.filter.longest_gap_s
    origin, k = np.nan, 0
    for reading in readings:
        now = reading.stamp
        believed = fusion.started and (fusion.confirms(now) or not fusion.leaps(now))
        if believed and now - fusion.stamp < longest:
            if not fusion.stamp - period <= origin + k * period <= fusion.stamp + longest:  # first row, or time jumped
                origin, k = fusion.stamp, 0
            while origin + k * period < now:
                yield estimate_row(configured, origin + k * period)
                k += 1
        taker.take(reading)
    if fusion.started:
        yield estimate_row(configured, fusion.stamp)


def estimate_row(configured: ConfiguredFilter, stamp: float) -> dict[str, float]:
    """The columns of an estimate at a time."""
    fusion, cascade = configured.fusion, configured.cascade
    belief = fusion.belief(stamp)
    row = {"t": float(stamp), **dict(zip(STATE, belief.mean.tolist(), strict=True))}
    row |= dict(zip(STDS, np.sqrt(np.maximum(belief.covariance.diagonal(), 0.0)).tolist(), strict=True))
    if fusion.datum is not None:
        row |= dict(zip(GEODETIC, fusion.geodetic(stamp).tolist(), strict=True))
    if cascade is not None and cascade.started:
        T = cascade.transforms(stamp)[0].pose.pose
        row |= dict(zip(MAP_ODOM, [*T[:3, 3].tolist(), *rotation_to_rpy(T[:3, :3]).tolist()], strict=True))
    return row


def _write(stream: TextIO, rows: Iterable[dict[str, float]], *, json_lines: bool) -> int:
    table: Any = None
    written = 0
    for row in rows:
        written += 1
        if json_lines:
            stream.write(json.dumps(row) + "\n")
            continue
        if table is None:
            table = csv.DictWriter(stream, list(row), lineterminator="\n", extrasaction="ignore")
            table.writeheader()
        exact = ("t", "lat", "lon")
        table.writerow({name: value if name in exact else f"{value:.9g}" for name, value in row.items()})
    return written


def _filters(configured: ConfiguredFilter) -> list[Fusion]:
    return [configured.cascade.local, configured.fusion] if configured.cascade else [configured.fusion]


def _counts(configured: ConfiguredFilter) -> str:
    lines = []
    for fusion in _filters(configured):
        sensors: dict[str, list[str]] = {}
        for (sensor, verdict), n in sorted(fusion.verdicts.items()):
            sensors.setdefault(sensor, []).append(f"{n} {verdict}")
        lines += [f"{fusion.options.frame_id} {sensor}: {', '.join(found)}" for sensor, found in sensors.items()]
    return "; ".join(lines) or "nothing"


def _account(configured: ConfiguredFilter) -> list[str]:
    belief = configured.fusion.belief()
    std = np.sqrt(belief.covariance.diagonal())
    place = ", ".join(f"{STATE[i]} {belief.mean[i]:.3f} ± {std[i]:.3f}" for i in (0, 1, 2, 5))
    return [*_counts(configured).split("; "), f"at {belief.stamp:.3f} s: {place} (m, rad)"]
