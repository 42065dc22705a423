"""slam_toolbox's parameters with the project's defaults, and what each of them sets here.

Parameters of slam_toolbox's internals (its solver's plug-ins, its smearing) are declared too, so that one file serves both
engines; they set nothing here, and the table says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from lupin_runtime import graph
from lupin_runtime.slam.local_map import FieldShape
from lupin_runtime.slam.loop_closure import LoopSettings
from lupin_runtime.slam.mapper import MapperSettings
from lupin_runtime.slam.occupancy import OccupancySettings
from lupin_runtime.slam.scan_matching import Window

NOTHING = "nothing: internal to slam_toolbox"


@dataclass(frozen=True)
class ParameterRow:
    """A parameter: its name, its default (which gives its type), and what it sets."""

    name: str
    default: Any
    sets: str


TABLE: tuple[ParameterRow, ...] = (
    ParameterRow("mode", "mapping", "only mapping: amcl does the localization"),
    ParameterRow("odom_frame", graph.ODOM_FRAME, "the frame under map"),
    ParameterRow("map_frame", graph.MAP_FRAME, "the frame of the map"),
    ParameterRow("base_frame", graph.BASE_FRAME, "the robot"),
    ParameterRow("scan_topic", graph.SCAN.name, "where scans come from"),
    ParameterRow("resolution", 0.05, "meters per cell of the map"),
    ParameterRow("min_laser_range", 0.25, "shortest reading used, m"),
    ParameterRow("max_laser_range", 12.0, "longest reading used, m"),
    ParameterRow("minimum_travel_distance", 0.3, "way between keyframes, m"),
    ParameterRow("minimum_travel_heading", 0.3, "turn between keyframes, rad"),
    ParameterRow("minimum_time_interval", 0.5, "time between keyframes, s"),
    ParameterRow("throttle_scans", 1, "take every n-th scan"),
    ParameterRow("map_update_interval", 5.0, "time between maps, s"),
    ParameterRow("transform_publish_period", 0.02, "time between map -> odom transforms, s"),
    ParameterRow("transform_timeout", 0.2, "how long a scan waits for odometry, and how far map -> odom is dated ahead, s"),
    ParameterRow("tf_buffer_duration", 30.0, "history of transforms, s"),
    ParameterRow("scan_buffer_size", 10, "scans that may wait for odometry"),
    ParameterRow("scan_buffer_maximum_scan_distance", 10.0, "path along the graph that still counts as the same place, m"),
    ParameterRow("use_scan_matching", True, "false: poses come from odometry alone"),
    ParameterRow("do_loop_closing", True, "false: no loop is closed"),
    ParameterRow("loop_search_maximum_distance", 3.0, "maximum distance of a loop closure candidate, m"),
    ParameterRow("loop_match_minimum_chain_size", 10, "minimum number of keyframes of a candidate"),
    ParameterRow("loop_match_minimum_response_coarse", 0.35, "score of the wide search"),
    ParameterRow("loop_match_minimum_response_fine", 0.45, "score of the refined match"),
    ParameterRow("loop_match_maximum_variance_coarse", 3.0, NOTHING),
    ParameterRow("loop_search_space_dimension", 8.0, "width of the search window for closures, m"),
    ParameterRow("loop_search_space_resolution", 0.05, "cells of local maps, m"),
    ParameterRow("loop_search_space_smear_deviation", 0.03, NOTHING),
    ParameterRow("correlation_search_space_dimension", 0.5, NOTHING),
    ParameterRow("correlation_search_space_resolution", 0.01, NOTHING),
    ParameterRow("correlation_search_space_smear_deviation", 0.1, NOTHING),
    ParameterRow("distance_variance_penalty", 0.5, NOTHING),
    ParameterRow("angle_variance_penalty", 1.0, NOTHING),
    ParameterRow("fine_search_angle_offset", 0.00349, NOTHING),
    ParameterRow("coarse_search_angle_offset", 0.349, NOTHING),
    ParameterRow("coarse_angle_resolution", 0.0349, NOTHING),
    ParameterRow("minimum_angle_penalty", 0.9, NOTHING),
    ParameterRow("minimum_distance_penalty", 0.5, NOTHING),
    ParameterRow("use_response_expansion", True, NOTHING),
    ParameterRow("solver_plugin", "solver_plugins::CeresSolver", NOTHING),
    ParameterRow("ceres_linear_solver", "SPARSE_NORMAL_CHOLESKY", NOTHING),
    ParameterRow("ceres_preconditioner", "SCHUR_JACOBI", NOTHING),
    ParameterRow("ceres_trust_strategy", "LEVENBERG_MARQUARDT", NOTHING),
    ParameterRow("stack_size_to_use", 40_000_000, NOTHING),
    ParameterRow("session_file", "", "not in slam_toolbox: the graph's file, from which a restarted node resumes; empty: none"),
)


def mapper_settings(values: Mapping[str, Any]) -> MapperSettings:
    """Convert parameter values to mapper settings."""
    base = MapperSettings()
    path_m = float(values["scan_buffer_maximum_scan_distance"])
    loops = replace(
        LoopSettings(),
        distance_m=float(values["loop_search_maximum_distance"]),
        beyond_path_m=path_m,
        chain=int(values["loop_match_minimum_chain_size"]),
        coarse_score=float(values["loop_match_minimum_response_coarse"]),
        fine_score=float(values["loop_match_minimum_response_fine"]),
        max_window=Window(float(values["loop_search_space_dimension"]) / 2.0, base.slip_window.half_rad),
        tries=1,
    )
    return replace(
        base,
        keyframe_m=float(values["minimum_travel_distance"]),
        keyframe_rad=float(values["minimum_travel_heading"]),
        keyframe_interval_s=float(values["minimum_time_interval"]),
        local_path_m=path_m,
        use_matching=bool(values["use_scan_matching"]),
        field_shape=FieldShape(
            cell_m=float(values["loop_search_space_resolution"]), reach_m=float(values["max_laser_range"]) + 2.0
        ),
        loops=loops if values["do_loop_closing"] else None,
        occupancy=OccupancySettings(resolution_m=float(values["resolution"])),
    )
