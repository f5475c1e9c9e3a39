"""G2: the reference's session rebuilt, 13 minutes over three rows with slip: wheels, GNSS, filter, cascade, AMCL."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from grape.experiments.filter_consistency import STATES, nees
from grape.experiments.g2_discord import accounted, heard, spoilt
from grape.experiments.g2_tracks import (
    ACCELERATED,
    ONE_FILTER,
    WAYS,
    WITH_AMCL,
    Track,
    at_its_fixes,
    followed,
    with_amcl,
)
from grape.experiments.quantities import median_of
from grape.experiments.skid_steer_log import (
    DATUM,
    SkidSteerLog,
    simulate_skid_steer,
    skid_steer_sensors,
    with_accelerations,
)
from grape.localization import Fusion, Reading
from grape.messages import Array
from grape.mission.record import write_atomic
from grape.mission.svg import line_chart
from grape.proof import Experiment, Figure, Proof, Quantity

SESSION_S, SETTLED_S = 780.0, 10.0
OUTAGES_S = ((100.0, 160.0), (240.0, 300.0), (620.0, 680.0))  # the second one over a change of row
RECOVERY_S = 20.0  # after an outage, before jumps count again
JUMP_EVERY_S, JUMP_M, JUMP_EFFECT_S = 13.0, 0.5, 1.0  # while it drives, stands and turns
NEES_RUNS = 20  # for each seed
TRUE = "#222222"
Progress = Callable[[float, str], None]
NOTES = (
    "Each session: three rows of 75 m with a stop beside a plant every 3 m, two changes of row, on a slope of 5 %. Each"
    " side's wheels slip by 4 % (one sigma, correlated over 2 s), the effective track of a drive is off by 10 % (one"
    " sigma), a bend costs 3 cm for each radian; the IMU's heading is off by up to 0.6 degrees, slowly; RTK fixes of"
    " 15 mm come once a second, 0.1 s late. Errors are of what is known at the time, ten times a second, from 10 s on.",
    "GNSS only: the newest fix that has come, held until the next; the place of the antenna, for it has no heading.",
    "EKF cascade: as the reference had it. The global filter gets GNSS and, ten times a second, the local filter's"
    " attitude and velocities. Two filters on the same readings (`Cascade` without a chain) would give the EKF's own"
    " estimate in map. Lag: the shift in time that fits the track best; the reference's are those of its nodes.",
    "EKF with accelerations: the IMU's specific forces too, means over a period with 0.02 m/s² of noise and a bias of"
    " 0.005 m/s² (one sigma). Between two stops they tell slip from driving.",
    "Without GNSS: three spells of 60 s a session, one of them over a change of row. Jumps: one fix in thirteen is half"
    " a metre off, to any side. How far the estimate moves as it comes, and how far it is then, within a second, from"
    " what it is with the right fix.",
    "EKF + AMCL: a laser of 181 beams twice a second, one beam in ten on weeds and people; the map has each plant and"
    " post 3 cm off and knows nothing of the 6 % of vines that died since. Discord: at 400 s all particles are moved on"
    " by one vine along the row, and from 460 to 480 s all fixes are 0.5 m off. How far the estimate is at most, within"
    " 40 s, from that with right sources, and after how long the discord is told; for how many seconds it is besides.",
    "NEES: 20 runs of 20 s a seed, of random motion by the filter's own model.",
)


def run(seeds: Sequence[int], folder: Path, progress: Progress) -> Proof:
    """One session for each seed; sessions that the folder has are not driven again."""
    sessions = []
    for k, seed in enumerate(seeds):
        path = folder / f"session{seed}.json"
        if not path.exists():
            write_atomic(path, json.dumps(session(seed, partial(progress, k / len(seeds)))))
        sessions.append(json.loads(path.read_text(encoding="utf-8")))
    return Proof(quantities=quantities(sessions), figures=figures(sessions[0]), notes=NOTES)


def session(seed: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Everything that is measured on one seed, as JSON takes it."""
    progress(f"seed {seed}: driving")
    log = simulate_skid_steer(seed, SESSION_S)
    tracks = {}
    for way in WAYS:
        progress(f"seed {seed}: {way.name}")
        tracks[way.name] = way.track(log)
    progress(f"seed {seed}: without GNSS, and with jumps")
    clean = tracks[ONE_FILTER]
    trouble, moved = troubled(log, np.random.default_rng([seed, 1]))
    accelerated = without_gnss(log)
    progress(f"seed {seed}: AMCL without GNSS, and with discord")
    with_discord, said = spoilt(log, with_amcl(log), _half_a_metre(np.random.default_rng([seed, 8])), spells(log))
    rng = np.random.default_rng([seed, 2])
    return {
        "seed": seed,
        "ways": {name: judged(track) for name, track in tracks.items()},
        "rmse_at_fixes": judged(at_its_fixes(log))["rmse"],
        "outages": [float(trouble.between(*spell).errors.max()) for spell in spells(log)],
        "outages_accelerated": [float(accelerated.between(*spell).errors.max()) for spell in spells(log)],
        "outages_amcl": [float(with_discord.between(*spell).errors.max()) for spell in spells(log)],
        "within_95_outages": float(np.mean(np.concatenate([trouble.between(*s).within_95 for s in spells(log)]))),
        "discord": accounted(tracks[WITH_AMCL], with_discord, said),
        "moved": list(moved.values()),
        "off": [_off(clean, trouble, stamp) for stamp in moved],
        "within_95": float(clean.between(SETTLED_S, np.inf).within_95.mean()),
        "nees": [nees(rng).mean(axis=0).tolist() for _ in range(NEES_RUNS)],
        "trouble": _line(trouble.stamps, trouble.errors),
        "trouble_accelerated": _line(accelerated.stamps, accelerated.errors),
        "trouble_amcl": _line(with_discord.stamps, with_discord.errors),
    }


def judged(track: Track) -> dict[str, Any]:
    """Errors of a track, and the track and its errors at every second to draw."""
    settled = track.between(SETTLED_S, np.inf)
    errors = settled.errors
    return {
        "rmse": float(np.sqrt(np.mean(errors**2))),
        "largest": float(errors.max()),
        "final": float(errors[-1]),
        "lag": settled.lag_s,
        "said": _line(*settled.said.T),
        "true": _line(*settled.true.T),
        "errors": _line(settled.stamps, errors),
    }


def spells(log: SkidSteerLog) -> list[tuple[float, float]]:
    """The times without GNSS that a log has whole."""
    return [spell for spell in OUTAGES_S if spell[1] <= log.stamps[-1]]


def troubled(log: SkidSteerLog, rng: np.random.Generator) -> tuple[Track, dict[float, float]]:
    """The track of the filter without GNSS at times and with some fixes that jump.

    Returns:
        the track, and by the time of each jump (s) how far the estimate moved when it came (m).
    """
    fusion, moved = Fusion(skid_steer_sensors(), datum=DATUM), {}

    def take(reading: Reading) -> None:
        stamp = reading.stamp
        if reading.sensor != "gnss" or not _jumps(log, stamp):
            fusion.take(reading)
            return
        now = fusion.stamp
        before = fusion.belief(now).mean[:2]
        fusion.take(replace(reading, geodetic=reading.geodetic + _half_a_metre(rng)))
        moved[stamp] = float(np.hypot(*(fusion.belief(now).mean[:2] - before)))

    return followed(log, fusion, take, filter(partial(heard, spells(log)), log.readings)), moved


def without_gnss(log: SkidSteerLog) -> Track:
    """The track of the filter with accelerations without GNSS at times."""
    fusion = Fusion(*with_accelerations(), datum=DATUM)
    return followed(log, fusion, fusion.take, filter(partial(heard, spells(log)), log.all_readings()))


def _jumps(log: SkidSteerLog, stamp: float) -> bool:
    """Whether the fix of that time jumps: now and then, and not where the filter has just been without any."""
    calm = not any(first - RECOVERY_S <= stamp <= last + RECOVERY_S for first, last in OUTAGES_S)
    seen = SETTLED_S < stamp < log.stamps[-1] - JUMP_EFFECT_S
    return calm and seen and round(stamp) % JUMP_EVERY_S == 0


def _half_a_metre(rng: np.random.Generator) -> Array:
    """(3,) degrees and m, to any side."""
    direction = rng.uniform(0.0, 2.0 * np.pi)
    per_m = 1.0 / 111_195.0
    east = np.cos(direction) / np.cos(np.radians(DATUM.latitude_deg))
    return np.array([np.sin(direction) * per_m, east * per_m, 0.0]) * JUMP_M


def _off(clean: Track, trouble: Track, stamp: float) -> float:
    """How far the two are apart at most, until the next fix after a jump."""
    a, b = (track.between(stamp, stamp + JUMP_EFFECT_S) for track in (clean, trouble))
    return float(np.hypot(*(a.said - b.said).T).max())


def _line(x: Array, y: Array) -> list[list[float]]:
    """Every tenth point, to a millimetre."""
    return np.column_stack([x, y])[::10].round(3).tolist()  # type: ignore[no-any-return]


def quantities(sessions: Sequence[dict[str, Any]]) -> tuple[Quantity, ...]:
    """The figures over all sessions."""
    n = len(sessions)
    found = []
    for way in WAYS:
        values = {key: [s["ways"][way.name][key] for s in sessions] for key in ("rmse", "largest", "final", "lag")}
        rmse, goal = float(np.sqrt(np.mean(np.square(values["rmse"])))), "<= 0.03" if way.name == ONE_FILTER else ""
        found += [
            Quantity(name=f"{way.name}: RMSE", unit="m", value=rmse, n=n, reference=way.reference, goal=goal),
            median_of(f"{way.name}: final error", "m", values["final"]),
            Quantity(name=f"{way.name}: largest error", unit="m", value=max(values["largest"]), n=n),
        ]
        if way.keeps_up:
            found.append(median_of(f"{way.name}: lag", "s", values["lag"]))
    fixes = float(np.sqrt(np.mean([s["rmse_at_fixes"] ** 2 for s in sessions])))
    found.append(Quantity(name="GNSS only, at the time of its fixes: RMSE", unit="m", value=fixes, n=n))
    return (*found, *_troubles(sessions), *_consistency(sessions))


def _troubles(sessions: Sequence[dict[str, Any]]) -> list[Quantity]:
    keys = ("outages", "outages_accelerated", "outages_amcl", "moved", "off")
    lost, lost_accelerated, lost_amcl, moved, off = ([value for s in sessions for value in s[key]] for key in keys)
    return [
        median_of("EKF, 60 s without GNSS: largest error", "m", lost),
        _largest("EKF, 60 s without GNSS: largest error, worst", lost, "<= 0.30"),
        median_of(f"{ACCELERATED}, 60 s without GNSS: largest error", "m", lost_accelerated),
        _largest(f"{ACCELERATED}, 60 s without GNSS: largest error, worst", lost_accelerated, "<= 0.30"),
        median_of("EKF + AMCL, 60 s without GNSS: largest error", "m", lost_amcl),
        _largest("EKF + AMCL, 60 s without GNSS: largest error, worst", lost_amcl, "<= 0.30"),
        _largest("EKF: moved by a jump of 0.5 m, at most", moved, "< 0.05"),
        _largest("EKF: off for want of the fix that jumped, at most", off, ""),
        *_discords(sessions),
    ]


def _discords(sessions: Sequence[dict[str, Any]]) -> list[Quantity]:
    found = []
    for key, name in (("alias", "AMCL one vine off"), ("held", "GNSS 0.5 m off for 20 s")):
        seen = [s["discord"][key] for s in sessions if key in s["discord"]]
        told = [case["told_after"] for case in seen if case["told_after"] is not None]
        found += [
            _largest(f"EKF + AMCL, {name}: estimate off the unspoilt one, at most", [case["off"] for case in seen], ""),
            Quantity(name=f"EKF + AMCL, {name}: discord told", unit="1", value=float(len(told)), n=len(seen)),
            median_of(f"EKF + AMCL, {name}: discord told after", "s", told),
        ]
    silent = [float(s["discord"]["false_s"]) for s in sessions]
    found.append(Quantity(name="EKF + AMCL: discord told else, of all", unit="s", value=sum(silent), n=len(silent)))
    return found


def _consistency(sessions: Sequence[dict[str, Any]]) -> list[Quantity]:
    per_state = np.array([run for s in sessions for run in s["nees"]]) / (STATES, 3)  # (runs, whole and position)
    n = len(per_state)
    means, halves = per_state.mean(axis=0), 1.96 * per_state.std(axis=0, ddof=1) / np.sqrt(n)
    names = ("NEES for each state, 1 is consistent", "NEES for each coordinate of the position")
    within, lost = (float(np.mean([s[key] for s in sessions])) for key in ("within_95", "within_95_outages"))
    return [
        *(
            Quantity(name=name, unit="1", value=float(m), n=n, ci95=(float(m - half), float(m + half)), goal="<= 1.1")
            for name, m, half in zip(names, means, halves, strict=True)
        ),
        Quantity(name="EKF: truth within its 95 % ellipse", unit="1", value=within, n=len(sessions)),
        Quantity(name="EKF: the same, 60 s without GNSS", unit="1", value=lost, n=len(sessions)),
    ]


def _largest(name: str, values: Sequence[float], goal: str) -> Quantity:
    return Quantity(name=name, unit="m", value=max(values, default=None), n=len(values), goal=goal)


def figures(first: dict[str, Any]) -> tuple[Figure, ...]:
    """Tracks and errors of one session."""
    ways, seed = first["ways"], first["seed"]
    paths = [("true", ways[ONE_FILTER]["true"], TRUE)] + [(w.name, ways[w.name]["said"], w.colour) for w in WAYS]
    fused = [(w.name, ways[w.name]["errors"], w.colour) for w in WAYS[2:]]
    colours = {w.name: w.colour for w in WAYS}
    lines = [
        ("EKF, with jumps", first["trouble"], colours[ONE_FILTER]),
        (ACCELERATED, first["trouble_accelerated"], colours[ACCELERATED]),
        ("EKF + AMCL, with discord", first["trouble_amcl"], colours[WITH_AMCL]),
    ]
    marks = [(spell[0], "no GNSS") for spell in OUTAGES_S]
    return (
        Figure(
            title=f"Tracks of seed {seed}",
            svg=line_chart(paths, x_title="east, m", y_title="north, m", height=420),
        ),
        Figure(
            title=f"Errors of the filters, seed {seed}",
            svg=line_chart(fused, x_title="s", y_title="m"),
        ),
        Figure(
            title="The same without GNSS for 60 s at a time",
            svg=line_chart(lines, x_title="s", y_title="m", marks=marks),
        ),
    )


EXPERIMENT = Experiment(
    row="G2",
    summary="Thirteen minutes over three rows with slip: wheels only, GNSS only, one EKF, the EKF cascade, AMCL.",
    seeds=range(500, 505),
    run=run,
)
