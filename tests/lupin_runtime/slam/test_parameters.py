"""slam_toolbox's parameters: all are declared, with the project's defaults, and take effect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from lupin_runtime.slam.parameters import NOTHING, TABLE, mapper_settings

DEFAULTS = {row.name: row.default for row in TABLE}

EXPECTED = {
    "mode": "mapping",
    "odom_frame": "odom",
    "map_frame": "map",
    "base_frame": "base_link",
    "resolution": 0.05,
    "min_laser_range": 0.25,
    "max_laser_range": 12.0,
    "transform_timeout": 0.2,
    "tf_buffer_duration": 30.0,
    "scan_buffer_size": 10,
    "scan_buffer_maximum_scan_distance": 10.0,
    "minimum_travel_distance": 0.3,
    "minimum_travel_heading": 0.3,
    "minimum_time_interval": 0.5,
    "map_update_interval": 5.0,
    "transform_publish_period": 0.02,
    "throttle_scans": 1,
    "loop_search_maximum_distance": 3.0,
    "loop_match_minimum_chain_size": 10,
    "loop_match_maximum_variance_coarse": 3.0,
    "loop_match_minimum_response_coarse": 0.35,
    "loop_match_minimum_response_fine": 0.45,
    "correlation_search_space_dimension": 0.5,
    "correlation_search_space_resolution": 0.01,
    "correlation_search_space_smear_deviation": 0.1,
    "loop_search_space_dimension": 8.0,
    "loop_search_space_resolution": 0.05,
    "loop_search_space_smear_deviation": 0.03,
    "distance_variance_penalty": 0.5,
    "angle_variance_penalty": 1.0,
    "fine_search_angle_offset": 0.00349,
    "coarse_search_angle_offset": 0.349,
    "coarse_angle_resolution": 0.0349,
    "minimum_angle_penalty": 0.9,
    "minimum_distance_penalty": 0.5,
    "stack_size_to_use": 40_000_000,
}


def test_defaults_have_slam_toolboxs_names() -> None:
    assert {name: DEFAULTS.get(name) for name in EXPECTED} == EXPECTED
    assert all(type(DEFAULTS[name]) is type(value) for name, value in EXPECTED.items())
    assert len(DEFAULTS) == len(TABLE)


@pytest.mark.parametrize(
    ("name", "value", "read"),
    [
        ("minimum_travel_distance", 0.7, lambda s: s.keyframe_m),
        ("minimum_travel_heading", 0.7, lambda s: s.keyframe_rad),
        ("minimum_time_interval", 0.7, lambda s: s.keyframe_interval_s),
        ("scan_buffer_maximum_scan_distance", 7.0, lambda s: s.local_path_m),
        ("resolution", 0.1, lambda s: s.occupancy.resolution_m),
        ("loop_search_maximum_distance", 2.0, lambda s: s.loops.distance_m),
        ("loop_match_minimum_chain_size", 4, lambda s: s.loops.chain),
        ("loop_match_minimum_response_coarse", 0.5, lambda s: s.loops.coarse_score),
        ("loop_match_minimum_response_fine", 0.6, lambda s: s.loops.fine_score),
        ("loop_search_space_dimension", 6.0, lambda s: 2.0 * s.loops.max_window.half_m),
        ("loop_search_space_resolution", 0.1, lambda s: s.field_shape.cell_m),
        ("use_scan_matching", False, lambda s: s.use_matching),
    ],
)
def test_parameter_changes_the_documented_setting(name: str, value: bool | float, read: Callable[..., Any]) -> None:
    assert read(mapper_settings(DEFAULTS)) != value
    assert read(mapper_settings({**DEFAULTS, name: value})) == value
    assert next(row for row in TABLE if row.name == name).sets != NOTHING


def test_disabled_loop_closing_searches_no_loop() -> None:
    assert mapper_settings(DEFAULTS).loops is not None
    assert mapper_settings({**DEFAULTS, "do_loop_closing": False}).loops is None
