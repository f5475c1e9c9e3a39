"""Where the hand goes to hang a dispenser: geometry of targets and of the nail board."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from paper_robot import Bench

from grape.actions.obstacles import UNSEEN
from grape.errors import GoalRejected, InvalidInput
from grape.geometry import inverse, rotation_z, transform
from grape.robots.husky_jaco2 import DESCRIPTION
from grape.tasks.dispenser.nail_board import NailBoard, T_base_tip, desired_markers, nail_target
from grape.tasks.dispenser.row import expect_row, plant_in_base, row_distance
from grape.tasks.dispenser.targets import AIM_DEPTH_M, HangTarget

UP = np.array([0.0, 0.0, 1.0])
T_HAND_CAMERA = DESCRIPTION.mounts["camera_optical"].T_parent_sensor


def nails(bench: Bench):
    return bench.robot.hand.T_hand_nails(DESCRIPTION.gripper.open_angle)


def in_nails(bench: Bench, target: HangTarget, point, back_off: float = 0.0):
    """A point (3,) of base_link relative to the nails' mid-point, along the hand's axes."""
    return transform(inverse(target.hand_pose(nails(bench), back_off) @ nails(bench)), point)


def spur(**changes) -> HangTarget:
    lean = np.array([0.3, -0.2, 0.9])
    target = HangTarget(
        plant="v0", kind="spur", tip=np.array([0.4, 0.85, 0.45]), direction=lean / np.linalg.norm(lean),
        pitch=np.radians(55.0), azimuth=np.radians(20.0),
    )  # fmt: skip
    return replace(target, **changes)


def test_the_nail_is_where_the_survey_says(bench: Bench) -> None:
    target = nail_target(bench.ctx, "n0", NailBoard())
    plant = bench.site.plant("n0")
    expected = transform(inverse(bench.base.T_map_base), np.array([*plant.target, plant.height_m]))
    assert target.tip == pytest.approx(expected, abs=1e-9)
    assert target.direction @ [0.0, -1.0, 0.0] == pytest.approx(np.cos(np.radians(15.0))), "out of the post"
    assert target.direction @ UP == pytest.approx(np.sin(np.radians(15.0)))
    assert target.kind == "nail" and target.azimuth == pytest.approx(0.0)


def test_a_robot_that_stands_askew_turns_the_target_with_it(bench: Bench) -> None:
    straight = nail_target(bench.ctx, "n0", NailBoard())
    bench.base.pose = bench.base.pose + np.array([0.0, 0.0, 0.1])
    bench.advance()
    askew = nail_target(bench.ctx, "n0", NailBoard())
    turn = rotation_z(-0.1)
    assert askew.tip == pytest.approx(turn @ straight.tip, abs=1e-9)
    assert askew.direction == pytest.approx(turn @ straight.direction, abs=1e-9)
    assert askew.rotation() == pytest.approx(turn @ straight.rotation(), abs=1e-9)


@pytest.mark.parametrize("plant", ["v0", "n1"])
def test_what_is_no_nail_with_two_markers_is_rejected(bench: Bench, plant: str) -> None:
    if plant == "n1":
        bare = replace(bench.site.plant("n0"), id="n1", markers=())
        bench.world.site = replace(bench.site, plants=(*bench.site.plants, bare))
    with pytest.raises(GoalRejected, match="nail mode needs a nail with two"):
        nail_target(bench.ctx, plant, NailBoard())


def test_the_nail_passes_28_mm_from_the_nail_line(bench: Bench) -> None:
    target = nail_target(bench.ctx, "n0", NailBoard())
    R = target.rotation()
    axis = R.T @ target.direction
    tip = in_nails(bench, target, target.tip)
    across = tip - axis * (tip[2] / axis[2])  # where the nail's axis passes the plane of the loop
    assert tip[0] == pytest.approx(0.0, abs=1e-9)
    assert (tip - AIM_DEPTH_M * axis)[1] == pytest.approx(0.028, abs=1e-9)
    assert 0.028 - 0.001 < across[1] < 0.140 / 2, "inside the loop, on its +y side"
    assert tip @ axis > 0 and abs(tip[2]) > 0.02, "the tip stands out of the loop, towards the hand"


def test_level_hand_points_at_the_post(bench: Bench) -> None:
    target = nail_target(bench.ctx, "n0", NailBoard())
    assert -target.rotation()[:, 2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9), "fingers along -z of the hand"
    assert target.rotation()[:, 1] == pytest.approx(UP, abs=1e-9)


@pytest.mark.parametrize("kind", ["nail", "spur"])
def test_backing_off_moves_the_hand_along_the_approach_alone(bench: Bench, kind: str) -> None:
    target = nail_target(bench.ctx, "n0", NailBoard()) if kind == "nail" else spur()
    near, far = target.hand_pose(nails(bench)), target.hand_pose(nails(bench), 0.10)
    assert far[:3, :3] == pytest.approx(near[:3, :3])
    assert far[:3, 3] - near[:3, 3] == pytest.approx(0.10 * target.approach)
    assert np.linalg.norm(target.approach) == pytest.approx(1.0)
    if kind == "nail":
        assert target.approach == pytest.approx(target.direction)
    else:
        angle_up, angle_spur = np.arccos(target.approach @ UP), np.arccos(target.approach @ target.direction)
        assert angle_up < np.arccos(target.direction @ UP) and angle_spur < np.arccos(target.direction @ UP)


def test_the_spur_passes_the_aim_point_of_the_loop(bench: Bench) -> None:
    target = spur()
    assert in_nails(bench, target, target.tip - AIM_DEPTH_M * target.approach) == pytest.approx([0, 0.028, 0], abs=1e-9)


def test_pitch_0_points_down_and_azimuth_turns_about_the_vertical() -> None:
    assert -spur(pitch=0.0, azimuth=0.0).rotation()[:, 2] == pytest.approx(-UP)
    assert -spur(pitch=np.pi / 2, azimuth=0.0).rotation()[:, 2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert -spur(pitch=np.pi / 2, azimuth=np.pi / 2).rotation()[:, 2] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "twig"}, "kind must be 'nail' or 'spur', got 'twig'"),
        ({"tip": np.array([0.1, np.nan, 0.0])}, "tip must be three finite numbers"),
        ({"direction": np.zeros(2)}, "direction must be three finite numbers"),
    ],
)
def test_a_malformed_target_is_refused(changes, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        spur(**changes)


def test_a_target_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        spur().tip[0] = 1.0


def test_markers_sit_left_and_right_of_the_nail_on_the_board(bench: Bench) -> None:
    target, board = nail_target(bench.ctx, "n0", NailBoard()), NailBoard()
    left, right = (T_base_tip(target) @ T for T in board.T_tip_markers((10, 11)).values())
    assert left[:3, 3] - target.tip == pytest.approx([-0.085, 0.0463, -0.030], abs=1e-9)
    assert right[:3, 3] - target.tip == pytest.approx([0.085, 0.0463, -0.030], abs=1e-9)
    assert left[:3, 2] == pytest.approx([0.0, -1.0, 0.0], abs=1e-9), "facing the aisle"


@pytest.mark.parametrize("back_off", [0.0, 0.08])
def test_desired_markers_are_what_the_camera_sees_from_the_hand_pose(bench: Bench, back_off: float) -> None:
    target, board = nail_target(bench.ctx, "n0", NailBoard()), NailBoard()
    desired = desired_markers(target, board, (10, 11), nails(bench), T_HAND_CAMERA, back_off)
    T_base_camera = target.hand_pose(nails(bench), back_off) @ T_HAND_CAMERA
    for id, T_tip in board.T_tip_markers((10, 11)).items():
        assert T_base_camera @ desired[id] == pytest.approx(T_base_tip(target) @ T_tip, abs=1e-9)
        x, y, z = desired[id][:3, 3]
        assert z > 0.1 and abs(466 * x / z) < 300 and abs(466 * y / z) < 220, "in view"


def test_the_row_is_beside_the_parked_robot(bench: Bench) -> None:
    assert row_distance(bench.ctx, "n0") == pytest.approx(0.335 + 0.62)
    assert plant_in_base(bench.ctx, "v0") == pytest.approx([1.47, 0.335 + 0.62, -0.132]), "on the ground"
    expect_row(bench.ctx, "n0")
    row, vine = bench.ctx.world.committed.pop(UNSEEN)
    assert row.center[1] - row.half_size[1] == pytest.approx(0.335 + 0.62 - 0.09), "its near face"
    assert vine.name == "v0" and vine.center[:2] == pytest.approx([1.47, 0.335 + 0.62]), "its arms reach into the aisle"
    assert vine.center[1] - vine.half_size[1] < row.center[1] - row.half_size[1]
