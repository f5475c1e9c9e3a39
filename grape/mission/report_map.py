"""The site map of the report: rows, fences, plants with their outcome, and the paths that are laid on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from grape.messages import Array
from grape.mission.svg import Frame, drawing, label, legend, tag, ticks
from grape.site import Site

WIDTH = 1080.0
MARGIN = 34.0
OUTCOME_COLOURS = {"deployed": "#3f9142", "skipped": "#dd9a22", "failed": "#c0392b"}
REFILL_COLOUR = "#7a5195"
TRUE_COLOUR, ESTIMATE_COLOUR = "#2d3e50", "#3b82c4"


def site_map(site: Site, path: Array, plants: Mapping[str, Mapping[str, Any]], layers: Sequence[str]) -> str:
    """The map as SVG, x to the right, y up, metres in the map frame.

    Args:
        path: (n, 4) t, x, y, yaw as estimated, or (n, 7) with the true x, y, yaw.
        plants: the mission's plants by id, as in result.json.
        layers: SVG elements to lie on the site, under the plants; what leaves the map is cut off.
    """
    frame, height = site_frame(site, path)
    parts = [tag("rect", x=0, y=0, width=WIDTH, height=height, fill="#f6f4ee", rx=8)]
    parts += _areas(site, frame)
    parts += _rows(site, frame)
    parts.append(tag("g", "".join(layers), clip_path="url(#map-edge)"))
    parts += _start(site, frame)
    parts += _refills(site, frame)
    parts += _plants(site, frame, plants)
    parts += _scale(frame, height)
    parts += legend([*OUTCOME_COLOURS.items(), ("fence", "#e3b5a4")], WIDTH - 12, 18)
    return drawing(WIDTH, height, parts, "map")


def site_frame(site: Site, path: Array, width: float = WIDTH) -> tuple[Frame, float]:
    """The part of a drawing that shows the site and the path (n, 4 or more), and the height of the whole drawing."""
    lines = [row.line for row in site.rows] + [area.polygon for area in site.fences] + [site.start[None]]
    lines += [point.position[None] for point in site.refills]
    if len(path):
        lines.append(path[:, 1:3])
    points = np.vstack(lines)
    low, high = points.min(axis=0) - 1.2, points.max(axis=0) + 1.2
    width -= 2 * MARGIN
    height = width * (high[1] - low[1]) / (high[0] - low[0])
    x, y = (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))
    return Frame(left=MARGIN, top=MARGIN, width=width, height=height, x=x, y=y), height + 2 * MARGIN


def _areas(site: Site, frame: Frame) -> list[str]:
    parts = []
    clip = tag("clipPath", tag("rect", x=0, y=0, width=WIDTH, height=frame.height + 2 * MARGIN, rx=8), id="map-edge")
    for area in site.headlands:
        points = frame.points(area.polygon)
        parts.append(tag("polygon", tag("title", escape(area.id)), points=points, class_="headland"))
    for area in site.fences:
        points = frame.points(area.polygon)
        parts.append(tag("polygon", tag("title", escape(area.id)), points=points, class_="fence"))
    return [tag("defs", clip), tag("g", "".join(parts), clip_path="url(#map-edge)")]


def _rows(site: Site, frame: Frame) -> list[str]:
    parts = []
    for row in site.rows:
        parts.append(tag("polyline", points=frame.points(row.line), class_="row"))
        end = max(row.line, key=lambda p: float(p[0]))
        x, y = frame.at(float(end[0]), float(end[1]))
        parts.append(label(x + 12, y + 4, row.id, class_="axis"))
    return parts


def _start(site: Site, frame: Frame) -> list[str]:
    heading = np.array([np.cos(site.start_heading_rad), np.sin(site.start_heading_rad)])
    side = np.array([-heading[1], heading[0]])
    arrow = np.array([heading * 0.45, -heading * 0.3 + side * 0.25, -heading * 0.3 - side * 0.25]) + site.start
    x, y = frame.at(float(site.start[0]), float(site.start[1]))
    return [
        tag("polygon", points=frame.points(arrow), fill="#6b7a8a"),
        label(x, y + 30, "start", class_="num", text_anchor="middle"),
    ]


def _refills(site: Site, frame: Frame) -> list[str]:
    """A diamond at each refill point, with a line the way the robot faces there."""
    parts = []
    for point in site.refills:
        ahead = np.array([np.cos(point.yaw_rad), np.sin(point.yaw_rad)])
        aside = np.array([-ahead[1], ahead[0]])
        diamond = np.array([ahead, aside, -ahead, -aside]) * 0.25 + point.position
        title = tag("title", escape(f"refill point {point.id}"))
        parts.append(tag("polygon", title, points=frame.points(diamond), fill=REFILL_COLOUR))
        parts.append(
            tag(
                "polyline",
                points=frame.points(np.array([point.position, point.position + 0.6 * ahead])),
                class_="line",
                stroke=REFILL_COLOUR,
            )
        )
        x, y = frame.at(float(point.position[0]), float(point.position[1]))
        parts.append(label(x, y + 30, point.id, class_="num", text_anchor="middle"))
    return parts


def _plants(site: Site, frame: Frame, plants: Mapping[str, Mapping[str, Any]]) -> list[str]:
    parts, labels = [], []
    for plant in site.plants:
        x, y = frame.at(float(plant.target[0]), float(plant.target[1]))
        served = plants.get(plant.id)
        if served is None:
            shape: dict[str, Any] = {"class_": "plant"}
        else:
            shape = {"fill": OUTCOME_COLOURS.get(served["outcome"], "#888"), "stroke": "#fff", "stroke_width": 1.5}
            lift = -14 if plant.side == "left" else 24
            labels.append(label(x, y + lift, plant.id, class_="tagged", text_anchor="middle"))
        title = tag("title", escape(plant.id + (f": {served['outcome']} {served['reason']}" if served else "")))
        size = 7 if served else 3
        if plant.kind == "nail":
            parts.append(tag("rect", title, x=x - size, y=y - size, width=2 * size, height=2 * size, rx=1, **shape))
        else:
            parts.append(tag("circle", title, cx=x, cy=y, r=size, **shape))
    return parts + labels


def _scale(frame: Frame, height: float) -> list[str]:
    metre = frame.width / (frame.x[1] - frame.x[0])
    length = ticks(0.0, (frame.x[1] - frame.x[0]) / 6, count=1)[-1] or 1.0
    y = height - 14
    return [
        tag("path", d=f"M14 {y - 4} v4 h{length * metre:.1f} v-4", class_="scale"),
        label(14 + length * metre + 6, y, f"{length:g} m", class_="num"),
        label(WIDTH - 40, height - 12, "N ↑", class_="axis"),
    ]
