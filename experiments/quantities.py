"""Quantities of a kind that several rows tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grape.proof import Quantity, median95


def median_of(name: str, unit: str, values: Sequence[float]) -> Quantity:
    """`<name>, median` with its 95 % interval; unknown when there are no values."""
    value = float(np.median(values)) if values else None
    return Quantity(name=f"{name}, median", unit=unit, value=value, n=len(values), ci95=median95(values))


def count_of(name: str, values: Sequence[int], goal: str = "= 0") -> Quantity:
    """How often something happened, over runs with so many each; unknown without runs."""
    return Quantity(name=name, unit="1", value=float(sum(values)) if values else None, n=len(values), goal=goal)
