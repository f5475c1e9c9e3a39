"""Keep what the wrist camera sees."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

from grape.actions.core import Context, Feedback, NoResult, action
from grape.actions.looking import next_image


@dataclass(frozen=True, kw_only=True)
class TakePictureGoal:
    """Attributes:
    label: what the picture is called in the run folder and in the report.
    timeout_s: the camera must show a new frame by then.
    """

    label: str = "view"
    timeout_s: float = 2.0


@action("TakePicture")
def take_picture(goal: TakePictureGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
    """Keeps a new picture of the wrist camera for the report; STALE_DATA when there is none."""
    image = yield from next_image(ctx, ctx.clock.now(), status="taking a picture", timeout_s=goal.timeout_s)
    ctx.log.picture(goal.label, image.bgr)
    return NoResult()
