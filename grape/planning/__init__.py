"""Collision-free motion of an arm: what it looks like, what is in the way, and a path around it."""

from grape.planning.checker import CheckerOptions, Nearest, StateChecker
from grape.planning.distance_field import (
    Ball,
    DistanceField,
    DistanceFieldOptions,
    build_distance_field,
    carve_distance_field,
    empty_field,
)
from grape.planning.planner import JointPath, JointPlanner, PlannerOptions
from grape.planning.spheres import LinkCapsule, SphereModel, StaticBox, build_sphere_model, cover_capsule

__all__ = [
    "Ball",
    "CheckerOptions",
    "DistanceField",
    "DistanceFieldOptions",
    "JointPath",
    "JointPlanner",
    "LinkCapsule",
    "Nearest",
    "PlannerOptions",
    "SphereModel",
    "StateChecker",
    "StaticBox",
    "build_distance_field",
    "build_sphere_model",
    "carve_distance_field",
    "cover_capsule",
    "empty_field",
]
