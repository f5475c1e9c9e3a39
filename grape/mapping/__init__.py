"""Maps of laser scans: occupancy grids and their files, laser logs, scan matching, laser SLAM, errors of ways."""

from grape.mapping.carmen import CarmenLog, parse_carmen, read_carmen
from grape.mapping.loops import LoopOptions
from grape.mapping.map_file import MapFormat, load_map, save_map
from grape.mapping.occupancy import OccupancyGrid
from grape.mapping.planar import between, chained, compose, transform_points
from grape.mapping.pose_graph import Edge, GraphOptions, Solution, optimise
from grape.mapping.scan_matcher import Match, MatchOptions, Reference, match
from grape.mapping.scans import GridOptions, grid_from_scans, predicted_ranges, scan_ends
from grape.mapping.site_map import map_of_site, plants_in_scan
from grape.mapping.slam import SlamOptions, SlamResult, run_slam
from grape.mapping.trajectory_error import (
    RelationError,
    TrajectoryError,
    relation_error,
    rigid_fit,
    trajectory_error,
)

__all__ = [
    "CarmenLog",
    "Edge",
    "GraphOptions",
    "GridOptions",
    "LoopOptions",
    "MapFormat",
    "Match",
    "MatchOptions",
    "OccupancyGrid",
    "Reference",
    "RelationError",
    "SlamOptions",
    "SlamResult",
    "Solution",
    "TrajectoryError",
    "between",
    "chained",
    "compose",
    "grid_from_scans",
    "load_map",
    "map_of_site",
    "match",
    "optimise",
    "parse_carmen",
    "plants_in_scan",
    "predicted_ranges",
    "read_carmen",
    "relation_error",
    "rigid_fit",
    "run_slam",
    "save_map",
    "scan_ends",
    "trajectory_error",
    "transform_points",
]
