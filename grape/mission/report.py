"""`report.html`: one self-contained page about one run, made from the files of its folder."""

from __future__ import annotations

import csv
import statistics
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from grape.mission.film import load_film
from grape.mission.page import document, none, number, picture, section, table, tiles
from grape.mission.record import read_events, read_json, write_atomic
from grape.mission.report_drive import drive_view, estimate_table, load_drive, map_beside_truth
from grape.mission.report_servo import servo_card, servo_runs
from grape.mission.result import true_places
from grape.mission.svg import PALETTE, drawing, label, line_chart, tag
from grape.site import load_site

MAX_PICTURES = 60


def write_report(folder: Path) -> None:
    """Write report.html from the other files of a run folder."""
    result = read_json(folder / "result.json")
    events = list(read_events(folder / "events.jsonl"))
    path = _read_path(folder / "path.csv")
    plants = {plant["id"]: plant for plant in result["plants"]}
    site, drive = load_site(folder / "site.geojson"), load_drive(folder)
    started = [(float(event["t"]), str(event["plant"])) for event in events if event["kind"] == "plant_started"]
    sections = [
        _header(result),
        section("Drive", drive_view(site, path, plants, drive, started, load_film(folder))),
        section("Plants", _plant_table(result) + _phase_bars(result)),
        section("Pictures", _pictures(folder, events)),
        section("Visual servoing", "".join(servo_card(run) for run in servo_runs(events)) or none("no servo run")),
        section("Localization", estimate_table(path, drive) + _localization(path, started)),
        section("Map beside the truth", map_beside_truth(site, path, drive)),
        section("Account and referee", _account(result) + _collisions(result)),
        section("What did not go well", _failures(events)),
    ]
    title = f"{result['mission']} seed {result['seed']}"
    write_atomic(folder / "report.html", document(title, sections))


def _read_path(path: Path) -> Any:
    with path.open(encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    return np.array(rows, float).reshape(-1, len(header))


def _header(result: dict[str, Any]) -> str:
    truth = result["truth"] or {}
    deployed = sum(plant["outcome"] == "deployed" for plant in result["plants"])
    cycles = [plant["cycle_s"] for plant in result["plants"] if plant["cycle_s"] is not None]
    median = statistics.median(cycles) if cycles else None
    figures = [
        (f"{deployed} / {len(result['plants'])}", "plants deployed"),
        (str(len(truth["hanging"])) if truth else "–", "hang by the referee"),
        (number(median, 0, " s"), "median cycle"),
        (number(result["sim_time_s"], 0, " s"), "simulated"),
        (f"×{result['real_time_factor']:.2f}", "real time"),
        (number(result["localization"]["position_rmse_m"], 3, " m"), "position error, RMS"),
        (number(truth.get("max_plant_force_n"), 1, " N"), "hardest touch of a plant"),
        (str(truth.get("fence_crossings", "–")), "fences crossed"),
        (number(result["navigation"]["distance_m"], 0, " m"), "driven"),
    ]
    ended = f"ended by {result['ended_by']}" + (f" · {n} sessions" if (n := result.get("sessions", 1)) > 1 else "")
    detail = f'<p class="detail">{escape(result["detail"])}</p>' if result.get("detail") else ""
    return (
        f'<header><h1>{escape(result["mission"])} <span class="badge {result["status"]}">{result["status"]}</span></h1>'
        f'<p class="sub">robot {escape(result["robot"])} · seed {result["seed"]} · {ended}</p>'
        f"{detail}{tiles(figures)}</header>"
    )


def _plant_table(result: dict[str, Any]) -> str:
    truth = (result["truth"] or {}).get("plants", {})
    rows = []
    for plant in result["plants"]:
        true, servo, outcome = truth.get(plant["id"], {}), plant["servo"], plant["outcome"]
        hangs = {True: "hangs", False: "does not hang", None: "–"}[true.get("hanging")]
        agrees = true.get("hanging") is None or true["hanging"] == (outcome == "deployed")
        rows.append(
            [
                f"<b>{escape(plant['id'])}</b>",
                plant["mode"].replace("_", " "),
                f'<span class="badge {outcome}">{outcome}</span>',
                hangs if agrees else f'<span class="badge bad">{hangs}</span>',
                number(true.get("offset_mm"), 1, " mm"),
                escape(plant["reason"].replace("_", " ")) or "–",
                str(plant["attempts"]),
                number(plant["cycle_s"], 1, " s"),
                number(servo["error_px"], 2, " px"),
                str(servo["iterations"] if servo["iterations"] is not None else "–"),
            ]
        )
    head = ["plant", "mode", "outcome", "referee", "offset", "reason", "attempts", "cycle", "servo error", "steps"]
    return table(head, rows)


def _phase_bars(result: dict[str, Any]) -> str:
    """One bar a plant, its phases as coloured pieces."""
    plants = [plant for plant in result["plants"] if plant["phases_s"]]
    if not plants:
        return ""
    phases = list(dict.fromkeys(name for plant in plants for name in plant["phases_s"]))
    colours = {name: _hue(k, len(phases)) for k, name in enumerate(phases)}
    longest = max(sum(plant["phases_s"].values()) for plant in plants)
    scale, parts = 900.0 / max(longest, 1e-6), []
    for k, plant in enumerate(plants):
        x, y = 80.0, 8 + 30 * k
        parts.append(label(70, y + 15, plant["id"], class_="axis", text_anchor="end"))
        for name, seconds in plant["phases_s"].items():
            title = tag("title", f"{name}: {seconds:.1f} s")
            parts.append(tag("rect", title, x=x, y=y, width=seconds * scale, height=20, fill=colours[name]))
            if seconds * scale > 40:
                parts.append(
                    label(x + seconds * scale / 2, y + 14, f"{seconds:.0f} s", class_="in", text_anchor="middle")
                )
            x += seconds * scale
    key = "".join(f'<span><i style="background:{colours[name]}"></i>{escape(name)}</span>' for name in phases)
    return "<h3>Time by phase</h3>" + drawing(1000, 30 * len(plants) + 12, parts, "bars") + f'<p class="key">{key}</p>'


def _hue(k: int, count: int) -> str:
    return PALETTE[k] if count <= len(PALETTE) else f"hsl({360 * k / count:.0f} 45% {46 if k % 2 else 58}%)"


def _pictures(folder: Path, events: Sequence[dict[str, Any]]) -> str:
    plant = ""
    cards: list[str] = []
    for event in events:
        if event["kind"] == "plant_started":
            plant = str(event["plant"])
        elif event["kind"] == "picture" and len(cards) < MAX_PICTURES:
            text = f"{str(event['name']).replace('_', ' ')} · {plant} · {event['t']:.1f} s"
            cards.append(picture(folder / event["file"], text))
    return f'<div class="pictures">{"".join(cards)}</div>' if cards else none("no pictures")


def _localization(path: Any, marks: Sequence[tuple[float, str]]) -> str:
    if path.shape[1] < 7 or not len(path):
        return none("the true path is not known")
    position = np.hypot(path[:, 1] - path[:, 4], path[:, 2] - path[:, 5])
    yaw = np.degrees(np.abs(np.remainder(path[:, 3] - path[:, 6] + np.pi, 2 * np.pi) - np.pi))
    times, size = path[:, 0], {"width": 1000, "height": 220}
    charts = (
        line_chart(
            [("position error", list(zip(times, position, strict=True)), PALETTE[0])],
            x_title="s", y_title="position error, m", marks=marks, **size,
        ),
        line_chart(
            [("yaw error", list(zip(times, yaw, strict=True)), PALETTE[1])],
            x_title="s", y_title="yaw error, degrees", marks=marks, **size,
        ),
    )  # fmt: skip
    return "".join(charts)


def _account(result: dict[str, Any]) -> str:
    own, truth = result["dispensers"], result["truth"]
    head = ["", "loaded", "on plants", "in the feeder", "on the hand", "lost"]
    rows = [["robot's own account", *(str(own[key]) for key in ("loaded", "deployed", "left", "on_hand", "lost"))]]
    if truth is not None and "places" in truth:
        places = true_places(truth)
        hanging = sum(number for place, number in places.items() if place not in ("feeder", "hand", "lost", "stock"))
        seen = [hanging, places["feeder"], places["hand"], places["lost"]]
        rows.append(["referee", str(sum(seen)), *(str(number) for number in seen)])
    return table(head, rows)


def _collisions(result: dict[str, Any]) -> str:
    truth = result["truth"]
    if truth is None:
        return ""
    rows = [
        [escape(c["a"]), escape(c["b"]), f"{c['force_n']:.1f} N", f"{c['time_s']:.1f} s"] for c in truth["collisions"]
    ]
    if not rows:
        return "<h3>Collisions</h3>" + none("none")
    return "<h3>Collisions</h3>" + table(["part", "part", "largest force", "first at"], rows)


def _failures(events: Sequence[dict[str, Any]]) -> str:
    rows = []
    for event in events:
        if event["kind"] == "action" and event["status"] in ("aborted", "rejected"):
            text = escape(str(event.get("detail", "")))
            rows.append([f"{event['t']:.1f} s", escape(event["name"]), escape(str(event.get("reason", ""))), text])
        elif event["kind"] == "crash":
            text = f"<pre>{escape(str(event.get('traceback', '')))}</pre>"
            rows.append([f"{event['t']:.1f} s", escape(str(event.get("path", ""))), "crash", text])
    return table(["at", "action", "reason", "detail"], rows) if rows else none("nothing")
