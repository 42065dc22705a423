"""The parameters of `mission_orchestrator` with their defaults; the node declares them from this table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any

from lupin_runtime import graph
from lupin_runtime.mission.frontier import FrontierSettings
from lupin_runtime.safety.battery_monitor import LOW_THRESHOLD


class BadParameter(ValueError):
    """An unusable parameter; the message names it and what was expected."""


@dataclass(frozen=True)
class MissionConfig:
    """The fields have the names of the ROS parameters; a suffix is the unit."""

    # -- names of topics, services and frames
    nav_action_name: str = graph.NAVIGATE_TO_POSE.name
    bridge_service_name: str = graph.GET_TAG_READING.name
    visual_confirmation_service: str = graph.CONFIRM_TAG.name
    arm_preset_service: str = graph.ARM_PRESET.name
    estop_topic: str = graph.ESTOP_STATE.name
    battery_topic: str = graph.BATTERY.name
    amcl_pose_topic: str = graph.AMCL_POSE.name
    discovered_tags_topic: str = graph.DISCOVERED_TAGS.name
    map_topic: str = graph.MAP.name
    base_frame: str = graph.BASE_FRAME
    frame_id: str = graph.MAP_FRAME
    mission_id_prefix: str = "lupin"
    state_publish_rate_hz: float = 5.0

    # -- files and tags that the operator specifies
    map_yaml_path: str = ""  # ignored, accepted for old launch files: the map comes from `map_topic`
    tag_locations_file: str = ""  # "" uses the layout in the greenhouse simulator's package
    approach_overrides_file: str = ""
    tag_sequence: tuple[str, ...] = ()

    # -- localization
    dependency_timeout_s: float = 30.0
    localization_timeout_s: float = 15.0
    localization_covariance_threshold: float = 0.25
    nav_localization_cov_threshold: float = 0.25

    # -- approach and navigation
    approach_yaw: float = 0.0
    approach_standoff_m: float = 0.5
    approach_room_m: float = 0.27  # free radius around an approach goal: the robot's 0.22 m plus a map cell; 0 disables it
    nav_timeout_s: float = 60.0
    nav_max_attempts: int = 2

    # -- scanning
    scan_timeout_s: float = 5.0
    flower_scan_dwell_s: float = 0.0
    require_visual_confirmation: bool = False
    visual_confirmation_timeout_s: float = 3.0
    arm_patrol_enabled: bool = False
    arm_inspect_preset: str = "inspect"
    arm_travel_preset: str = "home"
    arm_travel_settle_s: float = 0.0

    # -- docking
    dock_pose: tuple[float, ...] = (0.0, 0.0, 0.0)  # x, y, yaw; x = y = 0 uses the robot's position at the first start
    dock_timeout_s: float = 60.0
    dock_retry_max: int = 3
    battery_low_threshold: float = LOW_THRESHOLD

    # -- exploration and monitoring
    discovery_goal: int = 5  # 65535 searches for all tags that can be found
    frontier_free_thresh: int = 20
    frontier_occupied_thresh: int = 65
    frontier_min_cluster_cells: int = 6
    frontier_robot_clearance_m: float = 0.35
    frontier_robot_radius_cells: int = -1
    frontier_clearance_occupied_thresh: int = 65
    exploration_timeout_s: float = 180.0
    exploration_exhausted_s: float = 10.0  # with nothing left to explore for this long; longer than a map's update interval
    monitoring_sweeps: int = 0  # number of monitoring rounds; 0 continues forever
    seed_climate_on_discovery: bool = True
    coverage_enabled: bool = True
    coverage_range_m: float = 1.8
    coverage_hfov_rad: float = math.radians(60.0)
    coverage_camera_x_m: float = 0.147
    coverage_min_view_s: float = 0.5
    coverage_wall_weight: float = 0.0  # weight of outer walls, relative to boxes (1): tags usually hang on boxes

    @property
    def frontiers(self) -> FrontierSettings:
        """The settings of the frontier search."""
        return FrontierSettings(
            self.frontier_free_thresh,
            self.frontier_occupied_thresh,
            self.frontier_min_cluster_cells,
            self.frontier_robot_clearance_m,
            self.frontier_robot_radius_cells,
            self.frontier_clearance_occupied_thresh,
        )

    @staticmethod
    def from_parameters(values: Mapping[str, Any]) -> MissionConfig:
        """Check parameters and return the configuration. Raises BadParameter for an unknown name or an unusable value."""
        known = {field.name: field for field in fields(MissionConfig)}
        clean: dict[str, Any] = {}
        for name, value in values.items():
            if name not in known:
                similar = get_close_matches(name, known, n=1)
                hint = f"; did you mean {similar[0]}?" if similar else f"; its parameters: {', '.join(known)}"
                raise BadParameter(f"mission_orchestrator has no parameter {name!r}{hint}")
            if isinstance(value, float) and not math.isfinite(value):
                raise BadParameter(f"parameter {name} is {value}, expected a number")
            if name.endswith("_s") and isinstance(value, (int, float)) and value < 0:
                raise BadParameter(f"parameter {name} is {value}, expected seconds, 0 or more")
            clean[name] = tuple(value) if isinstance(known[name].default, tuple) else value
        config = MissionConfig(**clean)
        if len(config.dock_pose) != 3 or not all(map(math.isfinite, config.dock_pose)):
            raise BadParameter(f"parameter dock_pose is {list(config.dock_pose)}, expected [x, y, yaw]")
        if config.nav_max_attempts < 1:
            raise BadParameter(f"parameter nav_max_attempts is {config.nav_max_attempts}, expected 1 or more")
        return config
