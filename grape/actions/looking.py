"""Waiting for camera frames inside an action."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback
from grape.errors import ActionFailed, Reason, StaleData
from grape.messages import RgbdImage


def next_image(
    ctx: Context, newer_than: float, *, status: str, timeout_s: float = 2.0
) -> Generator[Feedback, None, RgbdImage]:
    """Waits for a camera frame taken after `newer_than` (s of the clock).

    Raises:
        ActionFailed: STALE_DATA when the camera gives none within the time-out.
    """
    deadline = ctx.clock.now() + timeout_s
    while True:
        try:
            image = ctx.camera.latest(max_age_s=timeout_s)
        except StaleData as error:
            if ctx.clock.now() > deadline:
                raise ActionFailed(Reason.STALE_DATA, f"{status}: {error}") from error
        else:
            if image.stamp > newer_than:
                return image
            if ctx.clock.now() > deadline:
                raise ActionFailed(Reason.STALE_DATA, f"{status}: no camera frame for {timeout_s} s")
        yield Feedback(status=status)


@dataclass(frozen=True, kw_only=True)
class Ballot:
    """How a vote over frames ended: the majority, how many said yes and no, and the reason of the last no."""

    value: bool
    yes: int
    no: int
    reason: str
    image: RgbdImage


def vote(
    ctx: Context, decide: Callable[[RgbdImage], tuple[bool, str]], *, frames: int, status: str
) -> Generator[Feedback, None, Ballot]:
    """Lets `decide` judge camera frames until a majority of `frames` is sure.

    Args:
        decide: gets a frame, returns the decision and, for a no, its reason.

    Raises:
        ActionFailed: STALE_DATA when the camera stops.
    """
    yes = no = 0
    reason = ""
    stamp = ctx.clock.now()
    while 2 * yes <= frames and 2 * no < frames:
        image = yield from next_image(ctx, stamp, status=status)
        stamp = image.stamp
        value, why = decide(image)
        yes, no = yes + value, no + (not value)
        reason = reason if value else why
        yield Feedback(status=status, progress=(yes + no) / frames)
    return Ballot(value=2 * yes > frames, yes=yes, no=no, reason=reason, image=image)
