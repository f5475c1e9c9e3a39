"""A local and a global filter side by side, and the frames map -> odom -> base_link that they span (REP-105)."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from grape.errors import InvalidInput
from grape.frames import FrameTree
from grape.geometry import inverse
from grape.localization.fusion import Fusion
from grape.localization.readings import Reading, reading_of_message
from grape.localization.state import Correction
from grape.messages import Odometry, PoseStamped


class Cascade:
    """The local filter moves smoothly in odom and may drift; the global one is right in map and may jump.

    Both take the same readings at the same time, each those of the sensors it knows, so neither lags behind the other.

    Args:
        local: filter of odom -> base_link, without absolute positions.
        global_: filter of map -> base_link.
        chain_every_s: when finite, the global filter also gets the local estimate this often, as readings of a sensor
            named "local": the layout in which the global filter has no wheels and no IMU of its own. It then knows no
            more than the last such reading, which is where a cascade's lag comes from.
    """

    def __init__(self, local: Fusion, global_: Fusion, *, chain_every_s: float = inf) -> None:
        frames = local.options, global_.options
        if frames[0].frame_id == frames[1].frame_id or frames[0].child_frame_id != frames[1].child_frame_id:
            raise InvalidInput(
                "a cascade needs two different frames over the same base, got "
                + " and ".join(f"{o.frame_id} -> {o.child_frame_id}" for o in frames)
            )
        if not chain_every_s > 0:
            raise InvalidInput(f"chain_every_s must be positive, got {chain_every_s}")
        self.local = local
        self.global_ = global_
        self._chain_every_s = chain_every_s
        self._chained = -inf

    @property
    def started(self) -> bool:
        """Whether both filters have an estimate."""
        return self.local.started and self.global_.started

    def take(self, reading: Reading) -> tuple[Correction, ...]:
        """Give a reading to each filter that knows its sensor; what became of it in both.

        Raises:
            InvalidInput: neither filter knows the sensor.
        """
        knowing = [f for f in (self.local, self.global_) if f.knows(reading.sensor)]
        if not knowing:
            raise InvalidInput(f"neither the local nor the global filter has a sensor {reading.sensor!r}")
        corrections: tuple[Correction, ...] = ()
        for fusion in knowing:
            corrections += fusion.take(reading)
        if self.local.started and self.local.stamp >= self._chained + self._chain_every_s:
            self._chained = self.local.stamp
            self.global_.take(reading_of_message("local", self.local.odometry()))
        return corrections

    def odometry(self, stamp: float | None = None) -> Odometry:
        """The global estimate: pose of base_link in map."""
        return self.global_.odometry(stamp)

    def transforms(self, stamp: float | None = None) -> tuple[Transform, ...]:
        """map -> odom and odom -> base_link at `stamp` (default: of the newer filter); map -> odom once there is one.

        Raises:
            InvalidInput: the local filter has no estimate yet.
        """
        if stamp is None:
            stamp = max(f.stamp for f in (self.local, self.global_) if f.started) if self.local.started else 0.0
        local = self.local.odometry(stamp)
        smooth = Transform.of(local, stamp)
        if not self.global_.started:
            return (smooth,)
        whole = self.global_.odometry(stamp)
        T_map_odom = PoseStamped(stamp=stamp, frame_id=whole.frame_id, pose=whole.pose @ inverse(local.pose))
        return (Transform(pose=T_map_odom, child_frame_id=local.frame_id), smooth)

    def push(self, frames: FrameTree, stamp: float | None = None) -> None:
        """Hand the transforms to a tree of frames."""
        for t in self.transforms(stamp):
            frames.push(t.pose.frame_id, t.child_frame_id, t.pose.pose, t.pose.stamp)


@dataclass(frozen=True, kw_only=True)
class Transform:
    """A frame in its parent: `pose.frame_id` is the parent, `pose.pose` is `T_parent_child` (4, 4)."""

    pose: PoseStamped
    child_frame_id: str

    @classmethod
    def of(cls, odometry: Odometry, stamp: float) -> Transform:
        """The pose of an odometry at a stamp."""
        return cls(
            pose=PoseStamped(stamp=stamp, frame_id=odometry.frame_id, pose=odometry.pose),
            child_frame_id=odometry.child_frame_id,
        )
