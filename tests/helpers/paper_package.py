"""A package that is not installed, with a plugin."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from types import SimpleNamespace

import pytest

from grape import plugins


def brought(monkeypatch: pytest.MonkeyPatch, kind: str, name: str, target: str) -> None:
    """Pretend that a package `vine-tools` is installed and brings one plugin of the group `kind`."""
    entry = EntryPoint(name=name, value=target, group=kind)
    vars(entry).update(dist=SimpleNamespace(name="vine-tools"))
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry] if group == kind else [])
