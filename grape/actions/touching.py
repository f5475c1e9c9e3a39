"""Work by contact."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from grape.actions.core import Context


@contextmanager
def touching(ctx: Context) -> Iterator[None]:
    """While the hand is to touch something, the arm's guard does not end its motion for that."""
    ctx.world.touching = True
    try:
        yield
    finally:
        ctx.world.touching = False
