"""Stamped transforms: a tree of frames, each edge fixed or with a short history (tf2's job, without threads)."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

import numpy as np

from grape.errors import GrapeError, InvalidInput, StaleData
from grape.geometry import interpolate, inverse, is_pose
from grape.messages import Array, frozen_array


class FrameError(GrapeError):
    """A transform that the tree cannot give: unknown frame, no connection, or a time that it does not cover."""


class StaleFrame(FrameError, StaleData):
    """A moving frame was not told of near the time that is asked for."""


class FrameTree:
    """Poses of frames in their parents, looked up between any two frames at any buffered time.

    Args:
        history_s: how long moving edges are kept.
        extrapolate_s: how far before or after its history a moving edge may be asked for; the nearest pose is used.
    """

    def __init__(self, history_s: float = 30.0, extrapolate_s: float = 0.05) -> None:
        self._history_s = history_s
        self._extrapolate_s = extrapolate_s
        self._parent: dict[str, str] = {}
        self._fixed: dict[str, Array] = {}
        self._stamps: dict[str, deque[float]] = {}
        self._poses: dict[str, deque[Array]] = {}

    def set_fixed(self, parent: str, child: str, T_parent_child: Array) -> None:
        """Declare a mount that never moves."""
        self._link(parent, child, T_parent_child)
        self._fixed[child] = frozen_array(T_parent_child, float)

    def push(self, parent: str, child: str, T_parent_child: Array, stamp: float) -> None:
        """Append the pose of a moving frame; stamps must not decrease."""
        self._link(parent, child, T_parent_child)
        stamps = self._stamps.setdefault(child, deque())
        poses = self._poses.setdefault(child, deque())
        if stamps and stamp < stamps[-1]:
            raise InvalidInput(f"{child}: stamp {stamp} is older than the newest one {stamps[-1]}")
        stamps.append(stamp)
        poses.append(frozen_array(T_parent_child, float))
        while stamps[0] < stamp - self._history_s:
            stamps.popleft()
            poses.popleft()

    def lookup(self, target: str, source: str, stamp: float | None = None) -> Array:
        """`T_target_source`, the pose of `source` in `target`, at `stamp` (None: the newest of every edge).

        Raises:
            FrameError: unknown or unconnected frames.
            StaleFrame: a stamp outside the buffered history.
        """
        up_target, up_source = self._ancestors(target), self._ancestors(source)
        common = next((frame for frame in up_target if frame in up_source), None)
        if common is None:
            raise FrameError(f"no connection between {target!r} and {source!r}; known frames: {sorted(self.frames())}")
        T_common_source = self._climb(source, common, stamp)
        T_common_target = self._climb(target, common, stamp)
        return inverse(T_common_target) @ T_common_source

    def frames(self) -> frozenset[str]:
        """Every frame the tree knows."""
        return frozenset(self._parent) | frozenset(self._parent.values())

    def _link(self, parent: str, child: str, T: Array) -> None:
        if not is_pose(T):
            raise InvalidInput(f"pose of {child!r} in {parent!r} is no rigid transform:\n{T}")
        known = self._parent.setdefault(child, parent)
        if known != parent:
            raise InvalidInput(f"frame {child!r} already hangs on {known!r}, not on {parent!r}")
        if child in self._ancestors(parent):
            raise InvalidInput(f"frame {child!r} would be its own ancestor through {parent!r}")

    def _ancestors(self, frame: str) -> list[str]:
        chain = [frame]
        while chain[-1] in self._parent:
            chain.append(self._parent[chain[-1]])
            if len(chain) > 1 and chain[-1] == frame:
                break
        return chain

    def _climb(self, frame: str, ancestor: str, stamp: float | None) -> Array:
        T_ancestor_frame = np.eye(4)
        while frame != ancestor:
            T_ancestor_frame = self._edge(frame, stamp) @ T_ancestor_frame
            frame = self._parent[frame]
        return T_ancestor_frame

    def _edge(self, child: str, stamp: float | None) -> Array:
        if child in self._fixed:
            return self._fixed[child]
        stamps, poses = self._stamps[child], self._poses[child]
        if stamp is None:
            return poses[-1]
        if not stamps[0] - self._extrapolate_s <= stamp <= stamps[-1] + self._extrapolate_s:
            raise StaleFrame(f"{child!r} at {stamp:.3f} s: only {stamps[0]:.3f} to {stamps[-1]:.3f} s are known")
        k = bisect_left(stamps, stamp)
        if k == 0:
            return poses[0]
        if k == len(stamps):
            return poses[-1]
        span = stamps[k] - stamps[k - 1]
        return interpolate(poses[k - 1], poses[k], (stamp - stamps[k - 1]) / span) if span > 0 else poses[k]
