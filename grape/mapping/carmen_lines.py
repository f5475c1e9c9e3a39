"""One line of a CARMEN log: which message, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grape.messages import Array

OLD_LASERS = ("FLASER", "RLASER")
ROBOT_LASERS = ("ROBOTLASER1", "ROBOTLASER2")
RAW_LASERS = tuple(f"RAWLASER{k}" for k in range(1, 6))
LASERS = (*OLD_LASERS, *ROBOT_LASERS, *RAW_LASERS)
OFFSETS = ("robot_frontlaser_offset", "robot_rearlaser_offset")  # m, parameters that are used
MOST_READINGS = 100_000
TAIL = 3  # ipc_timestamp, ipc_hostname, logger_timestamp


class LineProblem(Exception):
    """A known message is malformed; `column` counts from 1."""

    def __init__(self, word: str, column: int, got: str, allowed: str) -> None:
        super().__init__(got)
        self.word, self.column, self.got, self.allowed = word, column, got, allowed


@dataclass(frozen=True, kw_only=True)
class Scan:
    """A laser message. Poses (3,) x y yaw, None where the message has none; `range_max` 0 where it says none."""

    word: str
    stamp: float
    angle_min: float
    angle_increment: float
    range_max: float
    ranges: Array
    laser_pose: Array | None = None
    robot_pose: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Odom:
    """An ODOM message: pose (3,) by odometry."""

    stamp: float
    pose: Array


@dataclass(frozen=True, kw_only=True)
class TruePose:
    """A TRUEPOS message of CARMEN's simulator."""

    stamp: float
    pose: Array


def parse_line(line: str) -> Scan | Odom | TruePose | tuple[str, str] | str | None:
    """The message of a line; (name, value) of a PARAM, the word of an unknown message, None of an empty line.

    Raises:
        LineProblem: a known message is malformed.
    """
    tokens = line.split()
    if not tokens or tokens[0].startswith("#"):
        return None
    reader = _Reader(line, tokens)
    word = tokens[0]
    if word in OLD_LASERS:
        return _old_laser(reader)
    if word in ROBOT_LASERS or word in RAW_LASERS:
        return _new_laser(reader, with_poses=word in ROBOT_LASERS)
    if word == "ODOM":
        pose = reader.numbers(3, "x y theta")
        reader.numbers(3, "tv rv accel")
        return Odom(stamp=reader.stamp(), pose=pose)
    if word == "TRUEPOS":
        pose = reader.numbers(3, "true_x true_y true_theta")
        reader.numbers(3, "odom_x odom_y odom_theta")
        return TruePose(stamp=reader.stamp(), pose=pose)
    if word == "PARAM" and len(tokens) >= 3:
        if tokens[1] in OFFSETS:
            reader.next = 2
            reader.numbers(1, "metres")
        return tokens[1], tokens[2]
    return word


def _old_laser(reader: _Reader) -> Scan:
    ranges = reader.readings("num_readings")
    poses = reader.numbers(6, "x y theta odom_x odom_y odom_theta")
    start, step = old_angles(ranges.size)
    return Scan(
        word=reader.tokens[0],
        stamp=reader.stamp(),
        angle_min=start,
        angle_increment=step,
        range_max=0.0,
        ranges=ranges,
        laser_pose=poses[:3],
        robot_pose=poses[3:],
    )


def old_angles(readings: int) -> tuple[float, float]:
    """First angle and step (rad) of an old message, which says neither: a SICK of 180 degrees, or a Hokuyo's 270."""
    degrees = {180: (-90, 1.0), 360: (-90, 0.5), 720: (-90, 0.25), 401: (-50, 0.25), 541: (-135, 0.5)}
    degrees |= {1080: (-135, 0.25), 1081: (-135, 0.25)}
    start, step = degrees.get(readings, (-90, 180.0 / max(readings - 1, 1)))
    return float(np.radians(start)), float(np.radians(step))


def _new_laser(reader: _Reader, with_poses: bool) -> Scan:
    _, start, _, step, range_max, _, _ = reader.numbers(
        7, "type start_angle field_of_view angular_resolution maximum_range accuracy remission_mode"
    )
    for where, angle in ((2, start), (4, step)):
        if abs(angle) > 2 * np.pi:
            raise reader.problem(where, f"an angle of {reader.tokens[where]}", "radians, at most a turn")
    if range_max < 0.0:
        raise reader.problem(5, f"a maximum_range of {reader.tokens[5]}", "0 or more")
    ranges = reader.readings("num_readings")
    reader.readings("num_remissions")
    poses = reader.numbers(6, "laser_x laser_y laser_theta robot_x robot_y robot_theta") if with_poses else None
    if with_poses:
        reader.numbers(5, "tv rv forward_safety_dist side_safety_dist turn_axis")
    return Scan(
        word=reader.tokens[0],
        stamp=reader.stamp(),
        angle_min=float(start),
        angle_increment=float(step),
        range_max=float(range_max),
        ranges=ranges,
        laser_pose=None if poses is None else poses[:3],
        robot_pose=None if poses is None else poses[3:],
    )


class _Reader:
    """Takes the fields of a line one after the other."""

    def __init__(self, line: str, tokens: list[str]) -> None:
        self.line, self.tokens, self.next = line, tokens, 1

    def numbers(self, count: int, names: str) -> Array:
        taken = self.tokens[self.next : self.next + count]
        if len(taken) < count:
            raise self.problem(len(self.tokens), f"the line ends after {len(self.tokens)} words", f"{names}, then more")
        try:
            values = np.array(taken, dtype=float)
            bad = np.flatnonzero(~np.isfinite(values))
        except ValueError:
            bad = np.array([k for k, token in enumerate(taken) if not _is_float(token)])
        if bad.size:
            where = self.next + int(bad[0])
            raise self.problem(where, f"got {self.tokens[where][:40]!r}", f"a finite number ({names[:60]})")
        self.next += count
        return values

    def readings(self, name: str) -> Array:
        where = self.next
        count = float(self.numbers(1, name)[0])
        if not (count.is_integer() and 0 <= count <= MOST_READINGS):
            raise self.problem(where, f"{name} is {self.tokens[where]}", f"a whole number up to {MOST_READINGS}")
        values = self.numbers(int(count), f"{int(count)} readings")
        if values.size and values.min() < 0.0:
            bad = where + 1 + int(np.argmin(values))
            raise self.problem(bad, f"a reading of {self.tokens[bad]}", "0 or more")
        return values

    def stamp(self) -> float:
        """The ipc_timestamp, or the logger's where a message has no other."""
        left = len(self.tokens) - self.next
        if left != TAIL:
            where = min(self.next + TAIL, len(self.tokens))
            raise self.problem(
                where, f"{left} words after the message's fields", "ipc_timestamp ipc_hostname logger_timestamp"
            )
        return float(self.numbers(1, "ipc_timestamp")[0])

    def problem(self, token: int, got: str, allowed: str) -> LineProblem:
        column, start = len(self.line.rstrip()) + 1, 0
        for k, text in enumerate(self.tokens):
            start = self.line.index(text, start)
            if k == token:
                column = start + 1
                break
            start += len(text)
        return LineProblem(self.tokens[0], column, got, allowed)


def _is_float(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True
