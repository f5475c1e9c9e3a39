"""Which pose of a CARMEN log is odometry and which is corrected: logs say it in three ways.

1. Laser pose and robot pose of the scans differ by more than the laser's mount: the first is the corrected one.
2. They are the same and ODOM lines restart at the pose of each scan: the scans are corrected (as Gmapping writes
   logs), and odometry is the chain of steps between the ODOM lines.
3. They are the same and ODOM lines run through, or only repeat them: the scans have odometry, and nothing is
   corrected, unless there are TRUEPOS lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grape.mapping.carmen_lines import OFFSETS, Odom, Scan, TruePose
from grape.mapping.planar import between, compose
from grape.messages import Array

SAME = 1e-3  # m and rad: poses that are written with six digits


@dataclass(frozen=True, kw_only=True)
class Poses:
    """Poses of the robot at each scan; as in `CarmenLog`."""

    odometry: Array
    corrected: Array | None
    mount: Array


def resolve_poses(messages: Sequence[Scan | Odom | TruePose], parameters: Mapping[str, str], rear: bool) -> Poses | str:
    """Poses at each scan of one laser, or a sentence when there are none.

    Args:
        messages: in the order of the file; scans of one laser only.
        parameters: PARAM values; the laser's offset is used where the scans do not show the mount.
        rear: the laser looks backwards.
    """
    mount = _mount(parameters, rear)
    scans = [message for message in messages if isinstance(message, Scan)]
    if scans[0].robot_pose is None or scans[0].laser_pose is None:
        odometry = _at_stamps(messages, Odom, scans)
        if odometry is None:
            return "the scans have no pose, and there are no ODOM lines"
        return Poses(odometry=odometry, corrected=_at_stamps(messages, TruePose, scans), mount=mount)
    robot = np.array([scan.robot_pose for scan in scans])
    laser = np.array([scan.laser_pose for scan in scans])
    offset = between(robot, laser)
    middle = np.median(offset, axis=0)
    if np.abs(between(np.broadcast_to(middle, offset.shape), offset)).max() > SAME:
        return Poses(odometry=robot, corrected=compose(laser, between(mount, np.zeros(3))), mount=mount)
    if np.abs(middle).max() > SAME:
        mount = middle
    chained = _restarted_odometry(messages)
    if chained is not None:
        return Poses(odometry=chained, corrected=robot, mount=mount)
    return Poses(odometry=robot, corrected=_at_stamps(messages, TruePose, scans), mount=mount)


def _mount(parameters: Mapping[str, str], rear: bool) -> Array:
    front, back = OFFSETS
    offset = float(parameters.get(back if rear else front, 0.0))
    return np.array([offset, 0.0, np.pi if rear else 0.0])


def _at_stamps(
    messages: Sequence[Scan | Odom | TruePose], kind: type[Odom] | type[TruePose], scans: Sequence[Scan]
) -> Array | None:
    """Poses (n, 3) of ODOM or TRUEPOS messages, interpolated at the stamps of scans."""
    known = [message for message in messages if isinstance(message, kind)]
    if not known:
        return None
    known.sort(key=lambda message: message.stamp)
    stamps, poses = np.array([m.stamp for m in known]), np.array([m.pose for m in known])
    poses[:, 2] = np.unwrap(poses[:, 2])
    at = np.array([scan.stamp for scan in scans])
    return np.column_stack([np.interp(at, stamps, poses[:, k]) for k in range(3)])


def _restarted_odometry(messages: Sequence[Scan | Odom | TruePose]) -> Array | None:
    """Odometry (n, 3) at the scans of a log whose ODOM lines restart at every scan's pose, or None."""
    pose, last, scan_pose = np.zeros(3), None, None
    result, jumps, steps = [], 0, 0
    for message in messages:
        if isinstance(message, Odom):
            restart = scan_pose is not None and np.abs(message.pose - scan_pose).max() < SAME * SAME
            if last is not None and restart:
                jumps += bool(np.abs(between(last, message.pose)).max() > SAME)
            elif last is not None:
                pose = compose(pose, between(last, message.pose))
                steps += 1
            last, scan_pose = message.pose, None
        elif isinstance(message, Scan):
            if last is None:
                pose, last = np.array(message.robot_pose), message.robot_pose
            result.append(pose)
            scan_pose = message.robot_pose
    # a running odometry has steps, not jumps; a corrected log jumps at nearly every scan, and steps in between
    return np.array(result) if steps > 0.5 * len(result) and jumps > 0.3 * len(result) else None
