"""`report.html` of a campaign: one page, made from the content of campaign.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from grape.campaign.failures import PROCESS
from grape.campaign.reading import RunData
from grape.mission.page import document, none, number, picture, section, table, tiles
from grape.mission.svg import interval_chart
from grape.proof import wilson95

MAX_FAILURES = 60
MAX_LINKS = 8
SHORT_S = 0.05  # actions that never take longer are not shown


def campaign_page(summary: Mapping[str, Any], runs: Sequence[RunData], folder: Path) -> str:
    """The text of the page.

    Args:
        summary: content of campaign.json.
        folder: of the campaign; pictures of failures are read there.
    """
    sections = [
        _header(summary),
        section("How many hang", _rates(summary) + _groups(summary)),
        section("What the robot said, and what was so", _checks(summary)),
        section("What went wrong", _taxonomy(summary)),
        section("Failures, one by one", _failures(summary, folder)),
        section("Time by phase", _phases(summary)),
        section("Missions", _missions(runs)),
    ]
    return document(f"{summary['mission']}, seeds {summary['seeds']}", sections)


def percent(rate: float | None) -> str:
    """A rate as text."""
    return "–" if rate is None else f"{100 * rate:.1f} %"


def interval(bounds: Sequence[float]) -> str:
    """A 95 % interval of a rate as text."""
    return f"{100 * bounds[0]:.1f} … {100 * bounds[1]:.1f} %"


def _header(summary: Mapping[str, Any]) -> str:
    total, broken = summary["total"], summary["without_result"]
    figures = [
        (str(summary["missions"]), "missions with a result"),
        (f"{total['hanging']} / {total['n']}", "plants hang by the referee"),
        (percent(total["rate"]), interval(total["wilson95"])),
        (percent(summary["account_agreement"]), "the robot's account is right"),
        (str(summary["lost_unnoticed"]), "dispensers lost unnoticed"),
        (number(total["cycle_s_median"], 0, " s"), "median cycle"),
        (number(summary["max_plant_force_n"], 1, " N"), "hardest touch of a plant"),
        (str(summary["collisions"]), "pairs of parts that collided"),
        (str(summary["fence_crossings"]), "fences crossed"),
        (number((summary["position_rmse_m"] or {}).get("max"), 3, " m"), "position error, RMS, worst mission"),
    ]
    settings = [*summary["set"], *(f"{key} = {', '.join(values)} in turn" for key, values in summary["vary"].items())]
    sub = " · ".join([f"seeds {summary['seeds']}", *settings, f"grape {summary['grape']}"])
    notes = [f"no result: seeds {', '.join(map(str, broken))}"] if broken else []
    notes += [] if summary["complete"] else ["stopped before all seeds had run"]
    warning = "".join(f'<p class="detail">{note}</p>' for note in notes)
    return (
        f"<header><h1>{escape(summary['mission'])}: a campaign</h1>"
        f'<p class="sub">{escape(sub)}</p>{warning}{tiles(figures)}</header>'
    )


def _rates(summary: Mapping[str, Any]) -> str:
    rows = []
    for name, entries in summary["by"].items():
        if name == "mode" or len(entries) > 1:
            for entry in entries:
                text = f"{entry['hanging']} of {entry['n']}, {interval(entry['wilson95'])}"
                rows.append((f"{_words(name)}: {_words(entry['value'])}", entry["rate"], entry["wilson95"], text))
    return interval_chart(rows, width=900)


def _groups(summary: Mapping[str, Any]) -> str:
    rows, anything_else = [], any(group["varied"] for group in summary["groups"])
    for group in summary["groups"]:
        varied = ", ".join(f"{key} {value}" for key, value in group["varied"].items())
        conditions = [group["mode"], group["style"], group["light"], group["arm_errors"]]
        conditions += [varied] if anything_else else []
        rows.append(
            [escape("" if value is None else _words(value)) for value in conditions]
            + [f"{group['hanging']} of {group['n']}", percent(group["rate"]), interval(group["wilson95"])]
            + [number(group["cycle_s_median"], 1, " s")]
        )
    head = ["mode", "style", "light", "arm errors", *(["else"] if anything_else else [])]
    head += ["hang", "rate", "95 % interval", "cycle, median"]
    return table(head, rows) if rows else ""


def _checks(summary: Mapping[str, Any]) -> str:
    if not summary["checks"]:
        return none("the referee noted no look")
    rows = []
    for name, cells in summary["checks"].items():
        tp, fp, tn, fn = (cells[cell] for cell in ("tp", "fp", "tn", "fn"))
        numbers = [str(cell) for cell in (tp, fp, tn, fn)]
        meaning = f"<b>{escape(name)}</b>: {escape(cells['positive'])}"
        rows.append([meaning, *numbers, _wrong(fp, tp + fp), _wrong(fn, tn + fn)])
        if "level_right" in cells:
            right, wrong = cells["level_right"], cells["level_wrong"]
            meaning = f"<b>{escape(name)}</b>: this level is on top"
            rows.append([meaning, str(right), str(wrong), "", "", _wrong(wrong, right + wrong), ""])
    head = ["a yes means", "said yes, was so", "said yes, was not", "said no, was not", "said no, was so"]
    return table([*head, "wrong yes", "wrong no"], rows)


def _wrong(wrong: int, said: int) -> str:
    return f"{wrong} of {said} ({interval(wilson95(wrong, said))})" if said else "–"


def _taxonomy(summary: Mapping[str, Any]) -> str:
    cards = list(enumerate(summary["failures"][:MAX_FAILURES]))
    rows = []
    for row in summary["taxonomy"]:
        seen = [
            f'<a href="#failure{k}">{failure["seed"]} {escape(failure["plant"])}</a>'
            for k, failure in cards
            if (failure["action"], failure["reason"]) == (row["action"], row["reason"])
        ]
        more = " …" if len(seen) > MAX_LINKS else ""
        cells = [escape(row["action"]), escape(_words(row["reason"])), str(row["times"]), str(row["plants"])]
        rows.append([*cells, ", ".join(seen[:MAX_LINKS]) + more])
    note = '<p class="sub">How often an action failed, and how many plants that cost in the end.</p>'
    return note + table(["action", "reason", "times", "cost", "seed and plant"], rows) if rows else none("nothing")


def _failures(summary: Mapping[str, Any], folder: Path) -> str:
    cards = [_failure(k, failure, folder) for k, failure in enumerate(summary["failures"][:MAX_FAILURES])]
    left = len(summary["failures"]) - len(cards)
    more = f'<p class="sub">{left} more in campaign.json</p>' if left > 0 else ""
    return "".join(cards) + more or none("none")


def _failure(k: int, failure: Mapping[str, Any], folder: Path) -> str:
    at = f" at {failure['time_s']:.1f} s" if failure["time_s"] is not None else ""
    alone = "the mission's process" if failure["action"] == PROCESS else "the account of dispensers"
    where = f"{failure['plant']} ({_words(failure['mode'])}){at}" if failure["plant"] else alone
    known = {key: value for key, value in failure["conditions"].items() if value is not None}
    conditions = ", ".join(f"{_words(key)} {value}" for key, value in known.items())
    shown = picture(folder / failure["picture"], failure["picture"]) if failure["picture"] else ""
    return (
        f'<div class="servo pair" id="failure{k}"><div><h3>seed {failure["seed"]}, {escape(where)}</h3>'
        f"<p><b>{escape(failure['action'])}</b>: {escape(_words(failure['reason']))}</p>"
        f"<p>{escape(failure['detail'])}</p><p class='sub'>{escape(conditions)}</p>"
        f"<pre>{escape(failure['replay'])}</pre></div><div>{shown}</div></div>"
    )


def _phases(summary: Mapping[str, Any]) -> str:
    rows = [
        [_words(row["mode"]), escape(row["phase"]), str(row["n"]), f"{row['median_s']:.1f} s", f"{row['p90_s']:.1f} s"]
        for row in summary["phases"]
        if row["p90_s"] >= SHORT_S
    ]
    return table(["mode", "action", "n", "median", "90 %"], rows) if rows else none("nothing ran")


def _missions(runs: Sequence[RunData]) -> str:
    rows = []
    for run in runs:
        result, name = run.result, run.job.folder.name
        hanging = sum(plant.hanging for plant in run.plants)
        conditions = ", ".join(str(value) for value in run.conditions.values() if value is not None)
        rows.append(
            [
                f'<a href="{escape(name)}/report.html">{run.job.seed}</a>',
                escape(conditions),
                f'<span class="badge {result["status"]}">{result["status"]}</span>',
                escape(result["ended_by"]),
                f"{hanging} of {len(run.plants)}",
                f"{result['sim_time_s']:.0f} s",
                f"×{result['real_time_factor']:.2f}",
            ]
        )
    return table(["seed", "conditions", "status", "ended by", "hang", "simulated", "real time"], rows)


def _words(value: Any) -> str:
    return str(value).replace("_", " ")
