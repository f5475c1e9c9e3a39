"""What the robot on paper sees of the dispenser task."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from paper_robot import Bench

from grape.geometry import pose, transform
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.nail_board import NailBoard, T_base_tip, nail_target
from grape.tasks.dispenser.targets import HangTarget

FEEDER = DESCRIPTION.feeder


def fill_feeder(bench: Bench, dispensers: int) -> None:
    """The feeder's markers, and the wings of the dispenser on top of so many."""
    for id, place in zip(FEEDER.marker_ids, FEEDER.marker_positions, strict=True):
        bench.scene.markers[id] = FEEDER.T_base_link_feeder @ pose(None, place)
    if dispensers:
        top = FEEDER.T_base_link_level(dispensers - 1)
        bench.scene.wings = [transform(top, np.array([side * 0.020, 0.0, 0.0])) for side in (-1.0, 1.0)]


def put_nail(bench: Bench, shift: Any = (0.0, 0.0, 0.0)) -> HangTarget:
    """The nail `n0` with its markers, beside its surveyed place; returns it as it is."""
    board, surveyed = NailBoard(), nail_target(bench.ctx, "n0", NailBoard())
    T = T_base_tip(surveyed)
    T[:3, 3] += shift
    bench.scene.markers |= {id: T @ T_tip for id, T_tip in board.T_tip_markers((10, 11)).items()}
    return HangTarget(plant="n0", kind="nail", tip=T[:3, 3], direction=surveyed.direction, pitch=surveyed.pitch)


def spur_target(bench: Bench) -> HangTarget:
    """A spur that leans out of the row, within reach."""
    lean = np.array([0.1, -0.2, 1.0])
    return HangTarget(
        plant="v0", kind="spur", tip=np.array([0.45, 0.80, 0.55]), direction=lean / np.linalg.norm(lean),
        pitch=np.radians(55.0),
    )  # fmt: skip


def at_target(bench: Bench, target: HangTarget, back_off: float = 0.0) -> None:
    """Place the hand, fingers open, where it hangs a dispenser, or so far before."""
    gripper = DESCRIPTION.gripper
    bench.fingers.angles = np.array([gripper.thumb_clear, gripper.open_angle, gripper.open_angle])
    bench.fingers.target = bench.fingers.angles
    bench.put_hand(target.hand_pose(bench.robot.hand.T_hand_nails(gripper.open_angle), back_off))


@pytest.fixture
def task() -> SimpleNamespace:
    """Set-up of scenes and targets."""
    return SimpleNamespace(fill_feeder=fill_feeder, put_nail=put_nail, spur_target=spur_target, at_target=at_target)
