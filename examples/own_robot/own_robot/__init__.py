"""A robot of your own: the Husky of grape, driven more slowly, on drivers of its own (docs/own_robot.md)."""

from dataclasses import replace

from grape.robots.husky_jaco2 import DESCRIPTION as HUSKY

DESCRIPTION = replace(
    HUSKY,
    name="own_robot",
    base=replace(HUSKY.base, max_linear=0.5, max_angular=1.0),
    drivers={"machine": "own_robot.drivers:connect"},
)
