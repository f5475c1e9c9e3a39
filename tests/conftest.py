"""Fixtures for the tests of actions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from paper_robot import PLANTS, Bench, vine_row

from grape.actions.robot import build_robot
from grape.mission.ledger import SqliteLedger
from grape.navigation.route import RouteOptions, park_beside
from grape.robots.husky_jaco2 import DESCRIPTION


@pytest.fixture(scope="session")
def robot_models() -> Any:
    """The real robot's models."""
    return build_robot(DESCRIPTION)


@pytest.fixture
def bench(robot_models: Any, tmp_path: Path) -> Iterator[Bench]:
    """A robot on paper, parked so that its arm reaches the nail `n0`, with eight dispensers in the feeder."""
    site = vine_row()
    ledger = SqliteLedger.create(tmp_path / "ledger.sqlite", PLANTS, 8)
    x, y, yaw = park_beside(site, "n0", "fore", RouteOptions(lateral=0.335 + 0.62))
    made = Bench(robot_models, site, ledger, (x, y, yaw))
    made.advance(20)
    yield made
    ledger.close()
