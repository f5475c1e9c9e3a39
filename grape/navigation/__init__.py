"""Getting the base from one place to another: costmaps, global paths, local planner, collision monitor, routes."""

from grape.navigation.beams import ScanOptions, SliceOptions, beams_from_cloud, beams_from_scan, scan_points
from grape.navigation.costmap import Beams, InflationOptions, Layer, ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.follower import FollowerState, FollowerStep, LocalPlanner, Phase, PurePursuit, PursuitOptions
from grape.navigation.grid import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, GridSpec
from grape.navigation.monitor import MonitorOptions, speed_factor, time_to_contact
from grape.navigation.path import Path
from grape.navigation.planner import PlannerOptions, path_blocked, plan_path, plan_route
from grape.navigation.route import RouteOptions, park_beside, parking_pose, row_zones, waypoints
from grape.navigation.surroundings import Surroundings, SurroundingsOptions

__all__ = [
    "FREE",
    "INSCRIBED",
    "LETHAL",
    "UNKNOWN",
    "Beams",
    "Costmap",
    "FollowerState",
    "FollowerStep",
    "Footprint",
    "GridSpec",
    "InflationOptions",
    "Layer",
    "LocalPlanner",
    "MonitorOptions",
    "ObstacleLayer",
    "Path",
    "Phase",
    "PlannerOptions",
    "PolygonLayer",
    "PurePursuit",
    "PursuitOptions",
    "RouteOptions",
    "ScanOptions",
    "SliceOptions",
    "Surroundings",
    "SurroundingsOptions",
    "beams_from_cloud",
    "beams_from_scan",
    "layered_costmap",
    "park_beside",
    "parking_pose",
    "path_blocked",
    "plan_path",
    "plan_route",
    "row_zones",
    "scan_points",
    "speed_factor",
    "time_to_contact",
    "waypoints",
]
