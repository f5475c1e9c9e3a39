"""Small drawings for the report: charts and maps as SVG text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

PALETTE = ("#4878a8", "#e08a3c", "#5a9e5f", "#b85450", "#8068a8", "#8a6d5a", "#c97fae", "#7a7a7a", "#a8a03c", "#3fa3b0")


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A rectangle of the drawing and what it shows; y of the drawing points down, `up` turns data y upwards."""

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    up: bool = True

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Data to drawing."""
        u = (x - self.x[0]) / (self.x[1] - self.x[0])
        v = (y - self.y[0]) / (self.y[1] - self.y[0])
        return self.left + u * self.width, self.top + (1.0 - v if self.up else v) * self.height

    def points(self, xy: Iterable[Sequence[float]]) -> str:
        """The `points` attribute of a polyline."""
        return " ".join("{:.1f},{:.1f}".format(*self.at(float(p[0]), float(p[1]))) for p in xy)


def tag(name: str, content: str = "", /, **attributes: Any) -> str:
    """An element; `_` in attribute names means `-`, a trailing one is dropped."""
    text = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(_text(value))}"' for key, value in attributes.items()
    )
    return f"<{name}{text}>{content}</{name}>" if content else f"<{name}{text}/>"


def _text(value: Any) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def label(x: float, y: float, text: str, **attributes: Any) -> str:
    """A text element."""
    return tag("text", escape(text), x=x, y=y, **attributes)


def drawing(width: float, height: float, parts: Iterable[str], css_class: str = "") -> str:
    """A complete SVG that scales with the page."""
    body = "".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" class="{css_class}"'
        f' role="img">{body}</svg>'
    )


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """About `count` round numbers from `low` to `high`."""
    span = max(high - low, 1e-9)
    power = 10.0 ** math.floor(math.log10(span / count))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power * count >= span)
    first = math.ceil(low / step - 1e-9)
    return [round(k * step, 10) for k in range(first, math.floor(high / step + 1e-9) + 1)]


def axes(frame: Frame, x_title: str, y_title: str) -> list[str]:
    """Grid lines, numbers and titles."""
    parts = []
    for value in ticks(*frame.x):
        x, _ = frame.at(value, frame.y[0])
        parts.append(tag("line", x1=x, x2=x, y1=frame.top, y2=frame.top + frame.height, class_="grid"))
        parts.append(label(x, frame.top + frame.height + 14, f"{value:g}", class_="num", text_anchor="middle"))
    for value in ticks(*frame.y, count=4):
        _, y = frame.at(frame.x[0], value)
        parts.append(tag("line", x1=frame.left, x2=frame.left + frame.width, y1=y, y2=y, class_="grid"))
        parts.append(label(frame.left - 6, y + 3.5, f"{value:g}", class_="num", text_anchor="end"))
    middle = frame.left + frame.width / 2
    parts.append(label(middle, frame.top + frame.height + 30, x_title, class_="axis", text_anchor="middle"))
    parts.append(label(frame.left, frame.top - 7, y_title, class_="axis"))
    return parts


def line_chart(
    series: Sequence[tuple[str, Sequence[Sequence[float]], str]],
    *,
    x_title: str,
    y_title: str,
    width: float = 720,
    height: float = 230,
    marks: Sequence[tuple[float, str]] = (),
) -> str:
    """Lines over x.

    Args:
        series: name, points (x, y), colour.
        marks: x and text of vertical lines.
    """
    points = [p for _, line, _ in series for p in line]
    if not points:
        return '<p class="none">no data</p>'
    x_low, x_high = min(p[0] for p in points), max(p[0] for p in points)
    y_high = max(max(p[1] for p in points) * 1.08, 1e-6)
    y_low = min(0.0, min(p[1] for p in points))
    frame = Frame(
        left=52, top=24, width=width - 66, height=height - 64, x=(x_low, max(x_high, x_low + 1e-6)), y=(y_low, y_high)
    )
    parts = axes(frame, x_title, y_title)
    for k, (x_mark, text) in enumerate(marks):
        x, _ = frame.at(x_mark, y_low)
        parts.append(tag("line", x1=x, x2=x, y1=frame.top, y2=frame.top + frame.height, class_="mark"))
        parts.append(label(x + 3, frame.top + 10 + 11 * (k % 2), text, class_="num"))
    for name, line, colour in series:
        shape = tag("title", escape(name)) if name else ""
        parts.append(tag("polyline", shape, points=frame.points(line), stroke=colour, class_="line"))
    if len(series) > 1:
        parts += legend([(name, colour) for name, _, colour in series], frame.left + frame.width, 14)
    return drawing(width, height, parts, "chart")


def legend(entries: Sequence[tuple[str, str]], right: float, y: float) -> list[str]:
    """Names with their colours on one line that ends at `right`."""
    parts: list[str] = []
    x = right - sum(22 + 6.3 * len(name) for name, _ in entries)
    for name, colour in entries:
        parts.append(tag("rect", x=x, y=y - 8, width=10, height=10, rx=2, fill=colour))
        parts.append(label(x + 14, y + 1, name, class_="num"))
        x += 22 + 6.3 * len(name)
    return parts


def interval_chart(rows: Sequence[tuple[str, float, tuple[float, float], str]], *, width: float = 720) -> str:
    """Rates from 0 to 1 with their intervals, one line each.

    Args:
        rows: name, rate, interval, and a text that stands behind.
    """
    if not rows:
        return '<p class="none">no data</p>'
    height = 22.0 * len(rows)
    frame = Frame(left=210, top=20, width=width - 410, height=height, x=(0.0, 1.0), y=(0.0, len(rows)), up=False)
    parts = []
    for value in ticks(0.0, 1.0):
        x, _ = frame.at(value, 0.0)
        parts.append(tag("line", x1=x, x2=x, y1=frame.top, y2=frame.top + height, class_="grid"))
        parts.append(label(x, 14, f"{100 * value:g} %", class_="num", text_anchor="middle"))
    for k, (name, rate, (low, high), text) in enumerate(rows):
        (x0, y), (x1, _), (x, _) = (frame.at(value, k + 0.5) for value in (low, high, rate))
        parts.append(label(frame.left - 10, y + 4, name, class_="axis", text_anchor="end"))
        parts.append(tag("line", x1=x0, x2=x1, y1=y, y2=y, stroke=PALETTE[0], stroke_width=3.0))
        parts.append(tag("circle", cx=x, cy=y, r=4.5, fill=PALETTE[0]))
        parts.append(label(frame.left + frame.width + 10, y + 4, text, class_="num"))
    return drawing(width, height + 28, parts, "chart")
