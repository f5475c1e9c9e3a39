"""The film: a picture a second, a contact sheet, and its place in the report."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from grape.mission.film import Film, load_film


@pytest.fixture
def filmed(tmp_path: Path) -> Path:
    shades = iter(range(0, 250, 2))
    film = Film(tmp_path, lambda: np.full((48, 64, 3), next(shades), np.uint8))
    for beat in range(2150):
        film.see(0.01 * beat)
    film.close()
    return tmp_path


def test_a_picture_is_taken_each_second(filmed: Path) -> None:
    film = load_film(filmed)
    assert [round(t) for t, _ in film] == list(range(22))
    shades = [int(cv2.imread(str(filmed / file))[0, 0, 0]) for _, file in film]
    assert np.allclose(shades, np.arange(0, 44, 2), atol=1)


def test_the_contact_sheet_has_every_tenth_picture_in_a_line(filmed: Path) -> None:
    sheet = cv2.imread(str(filmed / "render" / "sheet.jpg"))
    assert sheet.shape == (240, 3 * 320, 3)
    assert np.allclose(sheet[120, [160, 480, 800], 0], [0, 20, 40], atol=1)


def test_a_run_without_a_film_has_no_pictures_of_one(tmp_path: Path) -> None:
    assert load_film(tmp_path) == []
