"""Stopping every actuator, whatever happens to one of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from grape.drivers import Drivers
from grape.errors import DriverError


def drivers(broken: tuple[str, ...] = ()) -> tuple[Drivers, list[str]]:
    stopped: list[str] = []

    def actuator(name: str) -> Any:
        def stop() -> None:
            stopped.append(name)
            if name in broken:
                raise OSError(f"no answer from the {name}")

        return SimpleNamespace(stop=stop)

    none: Any = None
    actuators = {name: actuator(name) for name in ("base", "arm", "gripper")}
    return Drivers(**actuators, camera=none, imu=none, gnss=none), stopped


def test_every_actuator_is_stopped() -> None:
    every, stopped = drivers()
    every.stop_all()
    assert stopped == ["base", "arm", "gripper"]


@pytest.mark.parametrize("broken", [("base",), ("arm",), ("base", "gripper")])
def test_the_others_stop_when_one_does_not_answer(broken: tuple[str, ...]) -> None:
    every, stopped = drivers(broken)
    with pytest.raises(DriverError, match="could not be stopped") as failure:
        every.stop_all()
    assert stopped == ["base", "arm", "gripper"]
    for name in broken:
        assert f"{name}: OSError: no answer from the {name}" in str(failure.value)
