"""Deployment poses of any vine's cloud: python examples/spurs_of_a_cloud.py [CLOUD [X Y Z]]

CLOUD is a text or .npy file with one point x y z (m) a line, cropped to one vine, z up; X Y Z is where the sensor stood
(default 0.5 m before the cloud along -y). Without a file a small vine is made up.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from grape.tasks.dispenser.perception.spurs import extract_poses


def tube(start: np.ndarray, end: np.ndarray, radius: float, rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) on the half of a tube that is seen from -y, with 0.6 mm of noise."""
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [0.0, -1.0, 0.0])
    side /= np.linalg.norm(side)
    n = int(4e5 * np.pi * radius * np.linalg.norm(end - start))
    along, angle = rng.uniform(0, 1, n)[:, None], rng.uniform(0, np.pi, n)[:, None]
    around = np.cos(angle) * side + np.sin(angle) * np.cross(side, axis)
    return start + along * (end - start) + radius * around + rng.normal(0, 0.0006, (n, 3))


def made_up_vine(rng: np.random.Generator) -> np.ndarray:
    """A cordon with three spurs on knobs."""
    parts = [tube(np.array([-0.35, 0, 0.75]), np.array([0.35, 0, 0.75]), 0.018, rng)]
    for x, lean in ((-0.2, 0.02), (0.0, 0.0), (0.2, -0.03)):
        foot, knob = np.array([x, 0, 0.75]), np.array([x, 0, 0.785])
        parts += [tube(foot, knob, 0.012, rng), tube(knob, np.array([x + lean, 0, 0.87]), 0.0045, rng)]
    return np.vstack(parts)


def main() -> None:
    """Print tip, lean, diameter and score of each spur, best first."""
    arguments = sys.argv[1:]
    if arguments:
        path = Path(arguments[0])
        points = np.load(path) if path.suffix == ".npy" else np.loadtxt(path, usecols=(0, 1, 2))
    else:
        points = made_up_vine(np.random.default_rng(0))
    before = np.median(points, axis=0) - [0.0, 0.5, 0.0]
    origin = np.array([float(v) for v in arguments[1:4]]) if len(arguments) == 4 else before
    for found in extract_poses(points, origin[None]):
        lean, diameter_mm = np.degrees(found.tilt(np.array([0.0, 0.0, 1.0]))), 1e3 * found.diameter_m
        print(f"tip {found.tip.round(3)} m, lean {lean:.0f} degrees, {diameter_mm:.1f} mm, score {found.score:.2f}")


if __name__ == "__main__":
    main()
