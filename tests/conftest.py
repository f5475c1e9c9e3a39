"""Fixtures for all tests, and a robot on paper for those of actions."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from paper_robot import PLANTS, Bench, vine_row

from grape.actions.robot import build_robot
from grape.mission.ledger import SqliteLedger
from grape.navigation.route import RouteOptions, park_beside
from grape.robots.husky_jaco2 import DESCRIPTION


@pytest.fixture(autouse=True)
def signals_arrive() -> Iterator[None]:
    """Signals reach the tests that send them, also where a shell ignores them for what it runs in its background."""
    handlers = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    ignored = [number for number in handlers if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, handlers[number])
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


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
