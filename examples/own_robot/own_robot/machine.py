"""A machine on paper where your maker's library would be: a thread moves it and calls back with its readings."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from grape.geodesy import Datum, geodetic_from_enu
from grape.geometry import pose, rotation_z, transform
from grape.messages import Array

DATUM = Datum(latitude_deg=42.3415, longitude_deg=3.0632, altitude_m=60.0)
ANTENNA = np.array([[-0.35, -0.20, 0.75]])
PERIOD_S = 0.01
TIMEOUT_S = {"base": 0.25, "arm": 0.05}  # after which they stop by themselves when nobody speaks to them


@dataclass
class Machine:
    """Follows commands exactly. `on_readings` is called every 10 ms from its own thread."""

    on_readings: Callable[[Machine], None]
    place: Array = field(default_factory=lambda: np.array([-3.0, -1.3, 0.0]))  # x, y, yaw in ENU at DATUM
    joints: Array = field(default_factory=lambda: np.array([4.71, 2.84, 0.7, 4.71, 4.71, 4.71]))
    fingers: Array = field(default_factory=lambda: np.zeros(3))
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    joint_velocity: Array = field(default_factory=lambda: np.zeros(6))

    def open(self) -> None:
        """Begin to move and to tell."""
        self._heard_s = {"base": 0.0, "arm": 0.0}
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop."""
        self._closing.set()
        self._thread.join()

    def drive(self, v: float, w: float) -> None:
        """m/s, rad/s."""
        self.velocity, self._heard_s["base"] = np.array([v, w]), time.monotonic()

    def turn_joints(self, velocity: Array) -> None:
        """(6,) rad/s."""
        self.joint_velocity, self._heard_s["arm"] = np.array(velocity), time.monotonic()

    def fix(self) -> Array:
        """Latitude and longitude (deg), altitude (m) of the antenna."""
        T_map_base = pose(rotation_z(self.place[2]), (*self.place[:2], 0.132))
        return geodetic_from_enu(DATUM, transform(T_map_base, ANTENNA))[0]

    def _run(self) -> None:
        before = time.monotonic()
        while not self._closing.wait(PERIOD_S):
            now = time.monotonic()
            dt, before = now - before, now
            if now - self._heard_s["base"] > TIMEOUT_S["base"]:
                self.velocity = np.zeros(2)
            if now - self._heard_s["arm"] > TIMEOUT_S["arm"]:
                self.joint_velocity = np.zeros(6)
            (v, w), yaw = self.velocity, self.place[2]
            self.place = self.place + dt * np.array([v * np.cos(yaw), v * np.sin(yaw), w])
            self.joints = self.joints + dt * self.joint_velocity
            self.on_readings(self)
