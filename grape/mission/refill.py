"""The key `refill` of a mission file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from grape.config import Document, Model
from grape.errors import Problem
from grape.site import Site


class Refill(Model):
    """How the feeder is refilled at the site's refill point.

    `stock`: dispensers that are ready there; left out, one for each plant beyond those in the feeder. `fill`: a refill
    brings the feeder up to so many. `after_s`: shortest and longest time that the simulated operator takes.
    """

    stock: Annotated[int, Field(ge=0, le=200)] | None = None
    fill: Annotated[int, Field(ge=1, le=8)] = 8
    after_s: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(le=3600)]] = (15.0, 40.0)


def check_refill(refill: Refill, site: Site, document: Document) -> Iterator[Problem]:
    """What does not fit together."""
    if refill.after_s[0] > refill.after_s[1]:
        got = f"got {list(refill.after_s)}"
        yield document.problem(("refill", "after_s"), got, "the shortest time, then the longest")
    if refill.stock and not site.refills:
        got = f"got {refill.stock}, but the site has no refill point"
        yield document.problem(("refill", "stock"), got, "0, or a feature of kind refill in the site file")
