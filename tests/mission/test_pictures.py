"""`grape render`: pictures of different subjects do not overwrite each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from grape.mission import pictures


def test_pictures_are_called_after_what_they_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr(pictures, "_take", lambda mission, name, out: shown.append(name))
    world = tmp_path / "slope.yaml"
    world.write_text("type: vineyard\nslope: 0.1\n")
    for subject in ("vineyard", str(world), "dispenser_deployment"):
        pictures.render_scene(subject, tmp_path, None, [])
    assert shown == ["vineyard", "slope", "dispenser_deployment"]
