"""`grape render`: pictures of different subjects do not overwrite each other."""

from __future__ import annotations

from pathlib import Path

import pytest
from paper_package import brought

from grape import plugins
from grape.mission import pictures


def test_pictures_are_called_after_what_they_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr(pictures, "_take", lambda mission, name, out: shown.append(name))
    world = tmp_path / "slope.yaml"
    world.write_text("type: vineyard\nslope: 0.1\n")
    for subject in ("vineyard", str(world), "dispenser_deployment"):
        pictures.render_scene(subject, tmp_path, None, [])
    assert shown == ["vineyard", "slope", "dispenser_deployment"]


def test_a_world_of_another_package_is_shown_with_its_own_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "short_yards.py").write_text(
        "from dataclasses import dataclass\n"
        "from grape.plugins import WorldType\n"
        "from grape.sim.worlds import VINEYARD, VineyardOptions\n"
        "@dataclass(frozen=True)\nclass Options:\n    seed: int = 0\n"
        "WORLD = WorldType(options=Options, site=lambda o: VINEYARD.site(VineyardOptions(rows=1)), grow=None)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    brought(monkeypatch, plugins.WORLDS, "short_yard", "short_yards:WORLD")
    monkeypatch.setattr(pictures, "_take", lambda mission, name, out: [f"{name} {len(mission.site.rows)}"])
    assert pictures.render_scene("short_yard", tmp_path, None, []) == ["short_yard 1"]
