"""Getting the base from one place to another: costmaps, global paths, local planner, collision monitor, routes."""

from grape.navigation.beams import ScanOptions, SliceOptions, beams_from_cloud, beams_from_scan, scan_points
from grape.navigation.collision_monitor import CollisionMonitor, CollisionOptions
from grape.navigation.costmap import Beams, InflationOptions, Layer, ObstacleLayer, PolygonLayer, layered_costmap
from grape.navigation.dwa import Dwa, DwaOptions
from grape.navigation.fence_guard import FenceGuard, FenceOptions
from grape.navigation.follower import FollowerState, FollowerStep, LocalPlanner, Phase, PurePursuit, PursuitOptions
from grape.navigation.grid import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, Footprint, GridSpec
from grape.navigation.ground import MeanGround
from grape.navigation.layers import (
    DenoiseLayer,
    FootprintLayer,
    InflationLayer,
    StaticLayer,
    StaticOptions,
    beams_from_range,
)
from grape.navigation.monitor import MonitorOptions, speed_factor, time_to_contact
from grape.navigation.mppi import Mppi, MppiOptions
from grape.navigation.path import Path
from grape.navigation.planner import GlobalPlanner, PlannerOptions, path_blocked, plan_path, plan_route
from grape.navigation.rolling import LayeredCostmap, layers_of
from grape.navigation.route import RouteOptions, park_beside, parking_pose, row_zones, waypoints
from grape.navigation.surroundings import Surroundings, SurroundingsOptions
from grape.navigation.teb import Teb, TebOptions
from grape.navigation.tracking import Situation, TrackingPlanner, Wish
from grape.navigation.turning import RoomToTurn, TurnRoomOptions, may_turn, room_to_turn
from grape.navigation.zones import SpeedZone, polygons_from_geojson, prohibited, speed_limit

__all__ = [
    "FREE",
    "INSCRIBED",
    "LETHAL",
    "UNKNOWN",
    "Beams",
    "CollisionMonitor",
    "CollisionOptions",
    "Costmap",
    "DenoiseLayer",
    "Dwa",
    "DwaOptions",
    "FenceGuard",
    "FenceOptions",
    "FollowerState",
    "FollowerStep",
    "Footprint",
    "FootprintLayer",
    "GlobalPlanner",
    "GridSpec",
    "InflationLayer",
    "InflationOptions",
    "Layer",
    "LayeredCostmap",
    "LocalPlanner",
    "MeanGround",
    "MonitorOptions",
    "Mppi",
    "MppiOptions",
    "ObstacleLayer",
    "Path",
    "Phase",
    "PlannerOptions",
    "PolygonLayer",
    "PurePursuit",
    "PursuitOptions",
    "RoomToTurn",
    "RouteOptions",
    "ScanOptions",
    "Situation",
    "SliceOptions",
    "SpeedZone",
    "StaticLayer",
    "StaticOptions",
    "Surroundings",
    "SurroundingsOptions",
    "Teb",
    "TebOptions",
    "TrackingPlanner",
    "TurnRoomOptions",
    "Wish",
    "beams_from_cloud",
    "beams_from_range",
    "beams_from_scan",
    "layered_costmap",
    "layers_of",
    "may_turn",
    "park_beside",
    "parking_pose",
    "path_blocked",
    "plan_path",
    "plan_route",
    "polygons_from_geojson",
    "prohibited",
    "room_to_turn",
    "row_zones",
    "scan_points",
    "speed_factor",
    "speed_limit",
    "time_to_contact",
    "waypoints",
]
