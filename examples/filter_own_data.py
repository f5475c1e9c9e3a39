"""The 15-state filter on data of your own: python examples/filter_own_data.py [LOG.csv]

Lines are `time_s,sensor,value,…`. Without a file: a circle, a drifting gyroscope, and one position that is far off.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from grape.localization import STATE, Ekf, EkfOptions, Measurement

# Which components a sensor measures, their standard deviations (m, rad, s), how far off it may be to be believed.
SENSORS = {
    "wheels": (("vx", "vy"), (0.03, 0.02), np.inf),
    "gyro": (("wz",), (0.02,), np.inf),
    "position": (("x", "y"), (0.03, 0.03), 5.0),
}


def made_up_log(rng: np.random.Generator) -> Iterator[list[str]]:
    """A minute on a circle of 2 m radius from (0, -2) at 0.5 m/s."""
    for k in range(1, 60 * 50):
        t = 0.02 * k
        yield [f"{t}", "wheels", f"{rng.normal(0.5, 0.03)}", f"{rng.normal(0, 0.02)}"]
        yield [f"{t}", "gyro", f"{rng.normal(0.25 + 0.01 * np.sin(t / 10), 0.02)}"]
        if k % 50 == 0:
            x, y = 2 * np.sin(0.25 * t) + 3.0 * (k == 1500), -2 * np.cos(0.25 * t)
            yield [f"{t}", "position", f"{rng.normal(x, 0.03)}", f"{rng.normal(y, 0.03)}"]


def measurements(lines: Iterable[list[str]]) -> Iterator[Measurement]:
    """Lines as measurements of some components of the state."""
    for time, sensor, *values in lines:
        names, std, gate = SENSORS[sensor.strip()]
        index, covariance = np.array([STATE.index(name) for name in names]), np.diag(np.square(std))
        value = np.array(values, float)
        yield Measurement(stamp=float(time), source=sensor, index=index, value=value, covariance=covariance, gate=gate)


def main() -> None:
    """Print the pose every ten seconds, and what was refused."""
    own = [line.split(",") for path in sys.argv[1:] for line in Path(path).read_text().splitlines()]
    ekf, next_line = Ekf(0.0, np.r_[0.0, -2.0, np.zeros(13)], np.eye(15) * 0.01, EkfOptions(two_d=True)), 10.0
    for measurement in measurements(own or made_up_log(np.random.default_rng(0))):
        done = ekf.correct(measurement)
        if not done.accepted:
            print(f"{measurement.stamp:5.1f} s  {measurement.source} {done.verdict}, distance {done.distance:.0f}")
        if measurement.stamp >= next_line:
            x, y, yaw = ekf.belief.mean[[0, 1, 5]]
            print(f"{measurement.stamp:5.1f} s  x {x:6.3f}  y {y:6.3f} m  yaw {np.degrees(yaw):6.1f} degrees")
            next_line += 10.0


if __name__ == "__main__":
    main()
