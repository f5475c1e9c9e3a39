"""The film of a simulated mission: pictures of a camera that follows the robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

PERIOD_S = 1.0
SHEET_EVERY = 10  # pictures of the film for one of the contact sheet
FOLDER = "render"


class Film:
    """Takes the pictures of a film, and makes a contact sheet of some of them.

    Args:
        folder: of the run.
        picture: takes one, (h, w, 3) RGB uint8.
    """

    def __init__(self, folder: Path, picture: Callable[[], Any]) -> None:
        self._folder = folder / FOLDER
        self._folder.mkdir()
        self._picture = picture
        self._taken = 0
        self._sheet: list[Any] = []

    def see(self, now: float) -> None:
        """Take a picture when one is due."""
        import cv2

        if now < self._taken * PERIOD_S:
            return
        bgr = self._picture()[:, :, ::-1]
        cv2.imwrite(str(self._folder / f"{now:07.1f}s.jpg"), bgr, [cv2.IMWRITE_JPEG_QUALITY, 80])
        if self._taken % SHEET_EVERY == 0:
            self._sheet.append(cv2.resize(bgr, (320, 240)))
        self._taken += 1

    def close(self) -> None:
        """Write the contact sheet: six pictures a line."""
        import cv2

        if not self._sheet:
            return
        columns = min(6, len(self._sheet))
        pictures = self._sheet + [np.full_like(self._sheet[0], 255)] * (-len(self._sheet) % columns)
        lines = [np.hstack(pictures[k : k + columns]) for k in range(0, len(pictures), columns)]
        cv2.imwrite(str(self._folder / "sheet.jpg"), np.vstack(lines))


def load_film(folder: Path) -> list[tuple[float, str]]:
    """Time and file, relative to the run folder, of each picture of a film; of a run without one that is nothing."""
    files = sorted((folder / FOLDER).glob("[0-9]*s.jpg"))
    return [(float(file.name.removesuffix("s.jpg")), f"{FOLDER}/{file.name}") for file in files]
