"""Frames in frames: poses between any two, at any time that is known."""

from __future__ import annotations

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.frames import FrameError, FrameTree
from grape.geometry import inverse, pose, rotation_z

T_MAP_BASE = pose(rotation_z(0.5), (1.0, 2.0, 0.0))
T_BASE_LASER = pose(rotation_z(np.pi), (0.4, 0.0, 0.2))
T_BASE_CAMERA = pose(rotation_z(-0.3), (0.1, 0.2, 0.9))


def along_x(x: float) -> np.ndarray:
    return pose(translation=(x, 0.0, 0.0))


@pytest.fixture
def tree() -> FrameTree:
    """A robot in its map, with two mounts."""
    tree = FrameTree(history_s=10.0, extrapolate_s=0.05)
    tree.set_fixed("base_link", "laser", T_BASE_LASER)
    tree.set_fixed("base_link", "camera", T_BASE_CAMERA)
    tree.push("map", "base_link", T_MAP_BASE, 0.0)
    return tree


def test_neighbours_cancel_up_and_down_the_tree(tree: FrameTree) -> None:
    np.testing.assert_allclose(tree.lookup("map", "laser"), T_MAP_BASE @ T_BASE_LASER)
    np.testing.assert_allclose(tree.lookup("laser", "map"), inverse(T_MAP_BASE @ T_BASE_LASER), atol=1e-15)
    np.testing.assert_allclose(tree.lookup("camera", "laser"), inverse(T_BASE_CAMERA) @ T_BASE_LASER, atol=1e-15)
    np.testing.assert_array_equal(tree.lookup("laser", "laser"), np.eye(4))
    assert tree.frames() == {"map", "base_link", "laser", "camera"}


def test_between_two_stamps_a_moving_frame_is_in_between_and_outside_only_for_a_moment(tree: FrameTree) -> None:
    for stamp, x in ((1.0, 1.0), (2.0, 3.0)):
        tree.push("base_link", "hand", along_x(x), stamp)
    places = [tree.lookup("base_link", "hand", stamp)[0, 3] for stamp in (0.96, 1.0, 1.25, 2.0, 2.04)]
    assert places == pytest.approx([1.0, 1.0, 1.5, 3.0, 3.0])
    assert tree.lookup("base_link", "hand")[0, 3] == 3.0
    for stamp in (0.94, 2.06):
        with pytest.raises(FrameError, match=r"only 1\.000 to 2\.000 s are known"):
            tree.lookup("base_link", "hand", stamp)


def test_what_is_older_than_the_history_is_forgotten(tree: FrameTree) -> None:
    for stamp in (1.0, 5.0, 12.0):
        tree.push("base_link", "hand", along_x(stamp), stamp)
    with pytest.raises(FrameError, match=r"only 5\.000 to 12\.000"):
        tree.lookup("base_link", "hand", 1.0)


def test_frames_that_nothing_connects_have_no_pose(tree: FrameTree) -> None:
    tree.set_fixed("barn", "door", np.eye(4))
    for source in ("door", "nowhere"):
        with pytest.raises(FrameError, match=f"no connection between 'map' and '{source}'"):
            tree.lookup("map", source)


@pytest.mark.parametrize(
    ("parent", "child", "T", "said"),
    [
        ("map", "laser", np.eye(4), "already hangs on 'base_link'"),
        ("laser", "map", np.eye(4), "its own ancestor"),
        ("map", "map", np.eye(4), "its own ancestor"),
        ("map", "barn", 2.0 * np.eye(4), "no rigid transform"),
    ],
)
def test_a_link_that_is_refused_leaves_the_tree_as_it_was(
    tree: FrameTree, parent: str, child: str, T: np.ndarray, said: str
) -> None:
    with pytest.raises(InvalidInput, match=said):
        tree.set_fixed(parent, child, T)
    np.testing.assert_allclose(tree.lookup("laser", "map"), inverse(T_MAP_BASE @ T_BASE_LASER), atol=1e-15)
    assert tree.frames() == {"map", "base_link", "laser", "camera"}


def test_stamps_do_not_decrease(tree: FrameTree) -> None:
    with pytest.raises(InvalidInput, match=r"stamp -1\.0 is older than the newest one 0\.0"):
        tree.push("map", "base_link", np.eye(4), -1.0)
    np.testing.assert_array_equal(tree.lookup("map", "base_link"), T_MAP_BASE)
