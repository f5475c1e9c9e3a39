"""Where the compiled kernels are fetched: numba is slow to load, and an import statement in every beat costs a µs."""

from __future__ import annotations

from functools import cache
from types import ModuleType


@cache
def kernels() -> ModuleType:
    """The compiled kernels, imported when they are first used."""
    from grape.control import _kernels

    return _kernels
