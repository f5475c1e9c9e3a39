"""Laser logs in CARMEN's text format: laser scans, odometry and corrected poses, one message a line.

Read are FLASER and RLASER (old), ROBOTLASER1 and 2 and RAWLASER1 to 5 (new), ODOM, TRUEPOS and PARAM; other messages
are counted. Files that end in .gz are unpacked.
Source: Carnegie Mellon Robot Navigation Toolkit, logger and readlog; log files of the Radish repository.
"""

from __future__ import annotations

import gzip
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np

from grape.errors import FileError, InvalidInput, Problem, with_suggestion
from grape.mapping.carmen_lines import LASERS, LineProblem, Odom, Scan, TruePose, parse_line
from grape.mapping.carmen_poses import Poses, resolve_poses
from grape.messages import Array, LaserScan, frozen_array

MOST_PROBLEMS = 20
LONGEST_LINE = 4_000_000  # letters: the most readings and remissions of a scan have half as many
NO_RETURN = 0.97  # of the largest reading: what an old message, which has no maximum range, means by "nothing"


@dataclass(frozen=True, kw_only=True)
class CarmenLog:
    """The scans of one laser of a log with the robot's pose at each.

    Args:
        file: name of the log.
        laser: message word that the scans came from.
        scans: in the laser's frame; ranges that mean no return are +inf, ranges of 0 are -inf (REP-117).
        odometry: (n, 3) x y yaw of the robot by its odometry, drifting.
        corrected: (n, 3) x y yaw that the log calls right, or None.
        mount: (3,) x y yaw of the laser on the robot.
        ignored: how many lines of other messages there were.
    """

    file: str
    laser: str
    scans: tuple[LaserScan, ...]
    odometry: Array
    corrected: Array | None
    mount: Array
    ignored: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("odometry", "corrected", "mount"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_array(getattr(self, name), float))

    @property
    def stamps(self) -> Array:
        """(n,) s."""
        return np.array([scan.stamp for scan in self.scans])


def read_carmen(path: Path, laser: str | None = None, max_range: float | None = None) -> CarmenLog:
    """Read a log.

    Args:
        laser: message word of the laser to take; default: the one with most scans.
        max_range: m, readings from here on are no return; default: what new messages say, and 0.97 of the largest
            reading in old ones.

    Raises:
        FileError: the file cannot be read, or lines of known messages are malformed (up to 20, each with its place).
        InvalidInput: `laser` is no laser message, or `max_range` is not positive.
    """
    try:
        unpack = gzip.open if path.suffix == ".gz" else open
        with unpack(path, "rt", encoding="latin-1") as stream:
            return parse_carmen(_lines(stream, str(path)), str(path), laser, max_range)
    except (OSError, EOFError, zlib.error) as error:
        text = getattr(error, "strerror", None) or error
        raise FileError([Problem(file=str(path), got=f"cannot be read: {text}", allowed="a CARMEN log")]) from error


def _lines(stream: TextIO, file: str) -> Iterator[str]:
    number = 0
    while line := stream.readline(LONGEST_LINE):
        number += 1
        if len(line) == LONGEST_LINE:
            allowed = f"less than {LONGEST_LINE} letters"
            raise FileError([Problem(file=file, line=number, got="the line is too long", allowed=allowed)])
        yield line


def parse_carmen(
    lines: Iterable[str], file: str, laser: str | None = None, max_range: float | None = None
) -> CarmenLog:
    """Read the lines of a log; arguments and errors as of `read_carmen`."""
    if laser is not None and laser not in LASERS:
        sentence = f"no laser message {laser!r}; allowed: {', '.join(LASERS)}"
        raise InvalidInput(with_suggestion(sentence, laser, LASERS))
    if max_range is not None and not max_range > 0:
        raise InvalidInput(f"max_range must be above 0, got {max_range}")
    messages: list[Scan | Odom | TruePose] = []
    parameters: dict[str, str] = {}
    ignored: Counter[str] = Counter()
    problems: list[Problem] = []
    for number, line in enumerate(lines, 1):
        try:
            message = parse_line(line)
        except LineProblem as problem:
            known = {"path": problem.word, "got": problem.got, "allowed": problem.allowed}
            problems.append(Problem(file=file, line=number, column=problem.column, **known))
            if len(problems) == MOST_PROBLEMS:
                break
            continue
        if isinstance(message, tuple):
            parameters[message[0]] = message[1]
        elif isinstance(message, str):
            ignored[message] += 1
        elif message is not None:
            messages.append(message)
    if problems:
        raise FileError(problems)
    return _log(messages, parameters, dict(ignored), file, laser, max_range)


def _log(
    messages: list[Scan | Odom | TruePose],
    parameters: Mapping[str, str],
    ignored: Mapping[str, int],
    file: str,
    laser: str | None,
    max_range: float | None,
) -> CarmenLog:
    counts = Counter(message.word for message in messages if isinstance(message, Scan))
    if not counts or (laser is not None and laser not in counts):
        there = ", ".join(counts) or "none"
        raise FileError([Problem(file=file, got=f"no scans of {laser or 'a laser'}", allowed=f"there are: {there}")])
    chosen = laser or max(counts, key=lambda word: (counts[word], -LASERS.index(word)))
    kept = [message for message in messages if not isinstance(message, Scan) or message.word == chosen]
    poses: Poses | str = resolve_poses(kept, parameters, rear=chosen in ("RLASER", "ROBOTLASER2"))
    if isinstance(poses, str):
        raise FileError([Problem(file=file, got=poses, allowed="scans with poses, or ODOM lines")])
    scans = [message for message in kept if isinstance(message, Scan)]
    return CarmenLog(
        file=file,
        laser=chosen,
        scans=tuple(_laser_scans(scans, max_range)),
        odometry=poses.odometry,
        corrected=poses.corrected,
        mount=poses.mount,
        ignored=ignored,
    )


def _laser_scans(scans: list[Scan], max_range: float | None) -> Iterable[LaserScan]:
    largest = NO_RETURN * max(float(scan.ranges.max(initial=0.0)) for scan in scans)
    for scan in scans:
        limit = max_range or scan.range_max or largest
        ranges = np.where(scan.ranges >= limit, np.inf, np.where(scan.ranges <= 0.0, -np.inf, scan.ranges))
        yield LaserScan(
            stamp=scan.stamp,
            frame_id=scan.word.lower(),
            angle_min=scan.angle_min,
            angle_increment=scan.angle_increment,
            range_min=0.0,
            range_max=limit,
            ranges=ranges,
        )
