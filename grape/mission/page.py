"""Pieces of a self-contained HTML page, shared by all reports."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from grape.mission.report_style import CSS

PICTURE_WIDTH = 420


def document(title: str, sections: Iterable[str]) -> str:
    """The whole page; sections are HTML."""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{CSS}</style></head>'
        f"<body>{''.join(sections)}</body></html>\n"
    )


def section(title: str, content: str) -> str:
    """A box with a title; the content is HTML."""
    return f"<section><h2>{escape(title)}</h2>{content}</section>"


def none(text: str) -> str:
    """What stands where there is nothing to show."""
    return f'<p class="none">{escape(text)}</p>'


def number(value: Any, digits: int = 1, unit: str = "") -> str:
    """A number with its unit, or a dash."""
    return "–" if value is None else f"{value:.{digits}f}{unit}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; cells are HTML."""
    top = "".join(f"<th>{name}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def tiles(figures: Iterable[tuple[str, str]]) -> str:
    """Large figures, each with what it is."""
    boxes = "".join(f'<div class="tile"><b>{value}</b><span>{name}</span></div>' for value, name in figures)
    return f'<div class="tiles">{boxes}</div>'


def picture(path: Path, text: str) -> str:
    """A picture file with its caption (plain text), made small and put into the page."""
    caption = escape(text)
    data = _jpeg(path)
    return (
        f'<figure><img alt="{caption}" src="data:image/jpeg;base64,{data}"><figcaption>{caption}</figcaption></figure>'
    )


def _jpeg(path: Path) -> str:
    import cv2

    bgr = cv2.imread(str(path))
    if bgr is None:
        return ""
    height = max(1, round(bgr.shape[0] * PICTURE_WIDTH / bgr.shape[1]))
    small = cv2.resize(bgr, (PICTURE_WIDTH, height), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return base64.b64encode(data.tobytes()).decode("ascii")
