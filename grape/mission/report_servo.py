"""The servo runs of the report: paths of the image corners and error over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from html import escape
from typing import Any

from grape.mission.svg import PALETTE, Frame, axes, drawing, line_chart, tag

IMAGE = (640.0, 480.0)


@dataclass(kw_only=True)
class ServoRun:
    """The samples of one servo run; `paths`: the places (u, v) px of each feature point, by marker and corner."""

    action: str
    plant: str
    start_s: float
    times: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    paths: dict[tuple[int, int], list[list[float]]] = field(default_factory=dict)
    desired: list[list[float]] = field(default_factory=list)
    end: dict[str, Any] = field(default_factory=dict)


def servo_runs(events: Iterable[dict[str, Any]]) -> list[ServoRun]:
    """Every servo run from its `servo_sample` events up to its `servo` event."""
    runs: list[ServoRun] = []
    current: ServoRun | None = None
    plant = ""
    for event in events:
        kind = event["kind"]
        if kind == "plant_started":
            plant = str(event["plant"])
        elif kind == "servo_sample":
            if current is None or current.action != event.get("action") or event["t"] - current.times[-1] > 2.0:
                current = ServoRun(action=str(event.get("action", "")), plant=plant, start_s=float(event["t"]))
                runs.append(current)
            _take(current, event)
        elif kind == "servo" and current is not None:
            current.end = event
            current = None
    return runs


def _take(run: ServoRun, event: dict[str, Any]) -> None:
    run.times.append(float(event["t"]))
    run.errors.append(float(event.get("error_px") or 0.0))
    corners = event.get("corners") or ()
    ids = event.get("ids") or (0,)
    for k, corner in enumerate(corners):
        marker, point = divmod(k, max(1, len(corners) // len(ids)))
        run.paths.setdefault((ids[marker], point), []).append(corner)
    run.desired = event.get("desired") or run.desired


def servo_card(run: ServoRun) -> str:
    """One run as a card: picture plane on the left, error on the right."""
    end = run.end
    result = f"{end['error_px']:.2f} px" if end.get("error_px") is not None else "an unknown error"
    converged = end.get("converged")
    badge = (
        ""
        if converged is None
        else f'<span class="badge {"ok" if converged else "bad"}">'
        + ("converged</span>" if converged else f"{escape(str(end.get('reason') or 'not converged'))}</span>")
    )
    duration = run.times[-1] - run.start_s
    error = [(t - run.start_s, e) for t, e in zip(run.times, run.errors, strict=True)]
    chart = line_chart([("error", error, PALETTE[0])], x_title="s", y_title="error, px", width=430, height=250)
    return (
        f'<div class="card servo"><h3>{escape(run.plant)} · {escape(run.action)} {badge}</h3>'
        f'<p class="sub">{len(run.times)} samples in {duration:.1f} s from {run.start_s:.1f} s, ends at {result}</p>'
        f'<div class="pair">{image_plane(run)}{chart}</div></div>'
    )


def image_plane(run: ServoRun) -> str:
    """The corners' paths through the picture and where they should end, as SVG."""
    frame = Frame(left=40, top=22, width=300, height=225, x=(0, IMAGE[0]), y=(0, IMAGE[1]), up=False)
    parts = [tag("rect", x=frame.left, y=frame.top, width=frame.width, height=frame.height, fill="#fff", stroke="#bbb")]
    parts += axes(frame, "u, px", "v, px")
    for k, path in enumerate(run.paths.values()):
        colour = PALETTE[k % len(PALETTE)]
        parts.append(tag("polyline", points=frame.points(path), class_="line", stroke=colour))
        x, y = frame.at(*path[0])
        parts.append(tag("circle", tag("title", "start"), cx=x, cy=y, r=3, fill="#fff", stroke=colour))
        x, y = frame.at(*path[-1])
        parts.append(tag("circle", tag("title", "end"), cx=x, cy=y, r=3, fill=colour))
    for point in run.desired:
        x, y = frame.at(float(point[0]), float(point[1]))
        parts.append(
            tag("path", tag("title", "desired"), d=f"M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10", class_="aim")
        )
    return drawing(352, 286, parts, "plane")
