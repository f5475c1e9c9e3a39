"""Several servo runs, one after the other, until one converges."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeVar

from grape.actions.core import Context, Feedback
from grape.errors import ActionFailed, InvalidInput, Reason

R = TypeVar("R")
TRY_AGAIN = (Reason.FEATURE_LOST, Reason.NOT_CONVERGED, Reason.DISTANCE_GROWS, Reason.IN_COLLISION, Reason.UNREACHABLE)


def with_retries(
    ctx: Context,
    tries: int,
    attempt: Callable[[], Generator[Feedback, None, R]],
    back: Callable[[], Generator[Feedback, None, None]],
    look: Callable[[], Generator[Feedback, None, None]] | None = None,
) -> Generator[Feedback, None, R]:
    """Servo again from the staging pose when a run failed for a reason that another look may cure.

    Args:
        tries: how often in all.
        attempt: makes one run, with a controller of its own.
        back: goes from where a run failed back to the staging pose; after the last run too.
        look: before each run, brings the features into view; when it fails there is no run.

    Raises:
        ActionFailed: why the last run, or looking around, failed.
    """
    for left in range(tries - 1, -1, -1):
        if look is not None:
            yield from look()
        try:
            return (yield from attempt())
        except ActionFailed as failed:
            yield from back()
            if left == 0 or failed.reason not in TRY_AGAIN:
                raise
            ctx.log.event("servo_again", reason=str(failed.reason), detail=failed.detail, left=left)
    raise InvalidInput(f"tries must be at least 1, got {tries}")
