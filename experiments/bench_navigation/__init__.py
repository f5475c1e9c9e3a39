"""`grape bench navigation`: each module of this folder times something by its `rows()`; a new file is measured too."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pkgutil import iter_modules

from grape.proof import Bench, Comparison


def modules() -> list[str]:
    """Names of what is timed, in the order in which it is."""
    return sorted(module.name for module in iter_modules(__path__))


def run(progress: Callable[[float, str], None]) -> tuple[Comparison, ...]:
    """Measure everything, one thing after the other."""
    rows: list[Comparison] = []
    names = modules()
    for k, name in enumerate(names):
        progress(k / len(names), name)
        rows += importlib.import_module(f"{__name__}.{name}").rows()
    return tuple(rows)


BENCH = Bench(
    name="navigation",
    summary="Where the robot is and how it gets on, beside peers that do the same.",
    run=run,
)
