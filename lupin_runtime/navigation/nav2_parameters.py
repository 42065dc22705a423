"""The parameters of Nav2 1.3 (ROS 2 Jazzy), from the same table of limits as Lupin's own navigation."""

from __future__ import annotations

import dataclasses
from typing import Any

from lupin_runtime import graph
from lupin_runtime.navigation.parameters import CostmapParameters, NavigationParameters, declare_parameters

_OF_OUR_CONTROLLER = ("controller_frequency", "seed", "robot_radius", "least_radius")  # not parameters of Nav2's
_HEIGHT_M = 2.0  # of an obstacle; the scan is flat


class _Defaults:
    """A node whose parameters have their defaults."""

    @staticmethod
    def parameter(_name: str, default: Any) -> Any:
        """Return the default."""
        return default


def nav2_parameters(simulated_time: bool) -> dict[str, Any]:
    """Return the parameters of Nav2's nodes, as in a file for `--params-file`."""
    values = declare_parameters(_Defaults())
    everywhere = {
        "use_sim_time": simulated_time,
        "bond_heartbeat_period": 0.0,  # no lifecycle manager listens: the process of the stack watches its programs
        "enable_stamped_cmd_vel": False,
        "robot_base_frame": graph.BASE_FRAME,
    }
    nodes = {
        "/**": everywhere,
        "controller_server": _controller(values),
        "planner_server": {
            "planner_plugins": ["GridBased"],
            "expected_planner_frequency": 1.0 / values.executive.planner_period_s,
            "GridBased": {
                "plugin": "nav2_navfn_planner::NavfnPlanner",
                "tolerance": values.planner.tolerance,
                "allow_unknown": values.planner.allow_unknown,
                "use_astar": False,
            },
        },
        "behavior_server": _behaviors(values),
        "bt_navigator": {
            "global_frame": graph.MAP_FRAME,
            "odom_topic": graph.ODOM.name,
            "navigators": ["navigate_to_pose", "navigate_through_poses"],
            "navigate_to_pose": {"plugin": "nav2_bt_navigator::NavigateToPoseNavigator"},
            "navigate_through_poses": {"plugin": "nav2_bt_navigator::NavigateThroughPosesNavigator"},
            "error_code_names": ["compute_path_error_code", "follow_path_error_code"],
        },
        "waypoint_follower": {
            "stop_on_failure": True,  # as Lupin's own
            "waypoint_task_executor_plugin": "wait_at_waypoint",
            "wait_at_waypoint": {"plugin": "nav2_waypoint_follower::WaitAtWaypoint", "waypoint_pause_duration": 200},
        },
    }
    local = {
        **_costmap(values, values.local_costmap, graph.ODOM_FRAME),
        "rolling_window": True,
        "width": int(values.local_costmap.width),
        "height": int(values.local_costmap.width),
        "plugins": ["obstacle_layer", "inflation_layer"],
    }
    whole = {
        **_costmap(values, values.global_costmap, graph.MAP_FRAME),
        "track_unknown_space": True,
        "plugins": ["static_layer", "obstacle_layer", "inflation_layer"],
        "static_layer": {"plugin": "nav2_costmap_2d::StaticLayer", "map_subscribe_transient_local": True},
    }
    return {
        **{name: {"ros__parameters": parameters} for name, parameters in nodes.items()},
        "local_costmap": {"local_costmap": {"ros__parameters": local}},
        "global_costmap": {"global_costmap": {"ros__parameters": whole}},
    }


def _controller(values: NavigationParameters) -> dict[str, Any]:
    fields = {item.name: getattr(values.mppi, item.name) for item in dataclasses.fields(values.mppi)}
    critics = {type(value).__name__: vars(value).copy() for value in fields.values() if dataclasses.is_dataclass(value)}
    del critics["ObstaclesCritic"]["inflation_radius"]  # Nav2 takes it from the costmap's layer
    numbers = {
        name: value for name, value in fields.items() if not dataclasses.is_dataclass(value) and name not in _OF_OUR_CONTROLLER
    }
    executive = values.executive
    return {
        "controller_frequency": values.mppi.controller_frequency,
        "failure_tolerance": executive.failure_tolerance,
        **{f"min_{axis}_velocity_threshold": values.velocity_threshold for axis in ("x", "y", "theta")},
        "progress_checker_plugins": ["progress_checker"],
        "goal_checker_plugins": ["goal_checker"],
        "controller_plugins": ["FollowPath"],
        "progress_checker": {
            "plugin": "nav2_controller::PoseProgressChecker",
            "required_movement_radius": executive.required_movement_radius,
            "required_movement_angle": executive.required_movement_angle,
            "movement_time_allowance": executive.movement_time_allowance,
        },
        "goal_checker": {
            "plugin": "nav2_controller::SimpleGoalChecker",
            "stateful": True,
            "xy_goal_tolerance": executive.tolerance.xy,
            "yaw_goal_tolerance": executive.tolerance.yaw,
        },
        "FollowPath": {
            "plugin": "nav2_mppi_controller::MPPIController",
            "motion_model": "Omni",
            "ay_min": -values.mppi.ay_max,
            **numbers,
            "critics": list(critics),
            **critics,
        },
    }


def _behaviors(values: NavigationParameters) -> dict[str, Any]:
    limits = values.executive.behaviors
    plugins = {"spin": "Spin", "backup": "BackUp", "drive_on_heading": "DriveOnHeading", "wait": "Wait"}
    return {
        "local_costmap_topic": "local_costmap/costmap_raw",
        "global_costmap_topic": "global_costmap/costmap_raw",
        "local_footprint_topic": "local_costmap/published_footprint",
        "global_footprint_topic": "global_costmap/published_footprint",
        "local_frame": graph.ODOM_FRAME,
        "global_frame": graph.MAP_FRAME,
        "cycle_frequency": limits.cycle_frequency,
        "simulate_ahead_time": limits.simulate_ahead_time,
        "max_rotational_vel": limits.max_rotational_vel,
        "min_rotational_vel": limits.min_rotational_vel,
        "rotational_acc_lim": limits.rotational_acc_lim,
        "behavior_plugins": list(plugins),
        **{name: {"plugin": f"nav2_behaviors::{kind}"} for name, kind in plugins.items()},
    }


def _costmap(values: NavigationParameters, costmap: CostmapParameters, frame: str) -> dict[str, Any]:
    return {
        "global_frame": frame,
        "robot_radius": values.inflation.robot_radius_m,
        "resolution": costmap.resolution,
        "update_frequency": costmap.update_frequency,
        "publish_frequency": costmap.publish_frequency,
        "always_send_full_costmap": True,  # the console reads no updates
        "obstacle_layer": {
            "plugin": "nav2_costmap_2d::ObstacleLayer",
            "observation_sources": "scan",
            "scan": {
                "topic": graph.SCAN.name,
                "data_type": "LaserScan",
                "marking": True,
                "clearing": True,
                "max_obstacle_height": _HEIGHT_M,
                "obstacle_max_range": costmap.obstacle_max_range,
                "obstacle_min_range": costmap.obstacle_min_range,
                "raytrace_max_range": costmap.raytrace_max_range,
                "raytrace_min_range": 0.0,
            },
        },
        "inflation_layer": {
            "plugin": "nav2_costmap_2d::InflationLayer",
            "inflation_radius": values.inflation.radius_m,
            "cost_scaling_factor": values.inflation.scaling,
        },
    }
