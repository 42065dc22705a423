"""Stand-ins for the programs of Nav2 1.3 and slam_toolbox 2.8: managed nodes with their interfaces, which do little.

`python -m tests.support.stand_in_engines EXECUTABLE --ros-args ...`; `install` puts them where `ros2 run` finds programs.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from lupin_runtime.stack.engines import NAV2, SLAM_TOOLBOX, Engine
from tests.support.paths import ROOT

# Names and types of parameters that the nodes declare, from the sources: b bool, i int, d double, s string, S list of strings.
# A value of another type is an error at the start of the real program.
EVERYWHERE = {"use_sim_time": "b", "bond_heartbeat_period": "d", "enable_stamped_cmd_vel": "b", "robot_base_frame": "s"}
_CRITICS = """
    ConstraintCritic.cost_weight:d ObstaclesCritic.repulsion_weight:d ObstaclesCritic.critical_weight:d
    ObstaclesCritic.collision_cost:d ObstaclesCritic.collision_margin_distance:d ObstaclesCritic.near_goal_distance:d
    GoalCritic.cost_weight:d GoalCritic.threshold_to_consider:d GoalAngleCritic.cost_weight:d
    GoalAngleCritic.threshold_to_consider:d PathAlignCritic.cost_weight:d PathAlignCritic.max_path_occupancy_ratio:d
    PathAlignCritic.trajectory_point_step:i PathAlignCritic.threshold_to_consider:d PathAlignCritic.offset_from_furthest:i
    PathFollowCritic.cost_weight:d PathFollowCritic.offset_from_furthest:i PathFollowCritic.threshold_to_consider:d
    PathAngleCritic.cost_weight:d PathAngleCritic.offset_from_furthest:i PathAngleCritic.threshold_to_consider:d
    PathAngleCritic.max_angle_to_furthest:d PreferForwardCritic.cost_weight:d PreferForwardCritic.threshold_to_consider:d
"""
_MPPI = f"""
    plugin:s motion_model:s time_steps:i model_dt:d batch_size:i iteration_count:i temperature:d gamma:d prune_distance:d
    vx_std:d vy_std:d wz_std:d vx_max:d vx_min:d vy_max:d wz_max:d ax_max:d ax_min:d ay_max:d ay_min:d az_max:d critics:S
    {_CRITICS}
"""
_SCAN = """
    topic:s data_type:s marking:b clearing:b max_obstacle_height:d obstacle_max_range:d obstacle_min_range:d
    raytrace_max_range:d raytrace_min_range:d
"""
_COSTMAP = f"""
    global_frame:s robot_radius:d resolution:d update_frequency:d publish_frequency:d always_send_full_costmap:b
    rolling_window:b track_unknown_space:b width:i height:i plugins:S
    obstacle_layer.plugin:s obstacle_layer.observation_sources:s
    {" ".join(f"obstacle_layer.scan.{each}" for each in _SCAN.split())}
    inflation_layer.plugin:s inflation_layer.inflation_radius:d inflation_layer.cost_scaling_factor:d
    static_layer.plugin:s static_layer.map_subscribe_transient_local:b
"""
PARAMETERS = {
    node: dict(each.split(":") for each in text.split())
    for node, text in {
        "controller_server": f"""
            controller_frequency:d failure_tolerance:d min_x_velocity_threshold:d min_y_velocity_threshold:d
            min_theta_velocity_threshold:d progress_checker_plugins:S goal_checker_plugins:S controller_plugins:S
            progress_checker.plugin:s progress_checker.required_movement_radius:d progress_checker.required_movement_angle:d
            progress_checker.movement_time_allowance:d goal_checker.plugin:s goal_checker.stateful:b
            goal_checker.xy_goal_tolerance:d goal_checker.yaw_goal_tolerance:d
            {" ".join(f"FollowPath.{each}" for each in _MPPI.split())}
        """,
        "planner_server": """
            planner_plugins:S expected_planner_frequency:d GridBased.plugin:s GridBased.tolerance:d GridBased.use_astar:b
            GridBased.allow_unknown:b
        """,
        "behavior_server": """
            local_costmap_topic:s global_costmap_topic:s local_footprint_topic:s global_footprint_topic:s local_frame:s
            global_frame:s cycle_frequency:d simulate_ahead_time:d max_rotational_vel:d min_rotational_vel:d
            rotational_acc_lim:d behavior_plugins:S spin.plugin:s backup.plugin:s drive_on_heading.plugin:s wait.plugin:s
        """,
        "bt_navigator": """
            global_frame:s odom_topic:s navigators:S error_code_names:S navigate_to_pose.plugin:s
            navigate_through_poses.plugin:s
        """,
        "waypoint_follower": """
            stop_on_failure:b waypoint_task_executor_plugin:s wait_at_waypoint.plugin:s
            wait_at_waypoint.waypoint_pause_duration:i
        """,
        "local_costmap": _COSTMAP,
        "global_costmap": _COSTMAP,
        "slam_toolbox": """
            mode:s odom_frame:s map_frame:s base_frame:s scan_topic:s resolution:d min_laser_range:d max_laser_range:d
            minimum_travel_distance:d minimum_travel_heading:d minimum_time_interval:d throttle_scans:i map_update_interval:d
            transform_publish_period:d transform_timeout:d tf_buffer_duration:d scan_buffer_size:i
            scan_buffer_maximum_scan_distance:d use_scan_matching:b do_loop_closing:b loop_search_maximum_distance:d
            loop_match_minimum_chain_size:i loop_match_minimum_response_coarse:d loop_match_minimum_response_fine:d
            loop_match_maximum_variance_coarse:d loop_search_space_dimension:d loop_search_space_resolution:d
            loop_search_space_smear_deviation:d correlation_search_space_dimension:d correlation_search_space_resolution:d
            correlation_search_space_smear_deviation:d distance_variance_penalty:d angle_variance_penalty:d
            fine_search_angle_offset:d coarse_search_angle_offset:d coarse_angle_resolution:d minimum_angle_penalty:d
            minimum_distance_penalty:d use_response_expansion:b solver_plugin:s ceres_linear_solver:s ceres_preconditioner:s
            ceres_trust_strategy:s stack_size_to_use:i use_lifecycle_manager:b
        """,
    }.items()
}
_CODES = {bool: "b", int: "i", float: "d", str: "s", list: "S"}
FAR_M = 5.0  # a goal beyond this is followed until it is cancelled
VELOCITIES_OF_NEAR_GOAL = 30  # at 20 Hz


def install(prefix: Path, engines: Iterable[Engine] = (NAV2, SLAM_TOOLBOX), versions: Mapping[str, str] | None = None) -> Path:
    """Install stand-ins into a prefix for AMENT_PREFIX_PATH, and return it. `versions` replaces those of packages."""
    for engine in engines:
        for program in engine.programs:
            version = (versions or {}).get(program.package, f"{engine.version}.7")
            marker = prefix / "share/ament_index/resource_index/packages" / program.package
            manifest = prefix / "share" / program.package / "package.xml"
            executable = prefix / "lib" / program.package / program.executable
            for path in (marker, manifest, executable):
                path.parent.mkdir(parents=True, exist_ok=True)
            marker.touch()
            manifest.write_text(f"<package><name>{program.package}</name><version>{version}</version></package>")
            module = f"{sys.executable} -m {__name__} {program.executable}"
            executable.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {module} "$@"\n')
            executable.chmod(0o755)
    return prefix


def parameter_mistakes(node: str, values: Mapping[str, Any]) -> list[str]:
    """Return which of the values (by their full names) the real node would ignore or refuse."""
    known = {**EVERYWHERE, **PARAMETERS[node]}
    return [
        f"{node}: {name} = {value!r}, expected {known.get(name, 'no such parameter')}"
        for name, value in values.items()
        if known.get(name) != _CODES.get(type(value))
    ]


def main(executable: str) -> None:
    """Run a stand-in until a signal."""
    import rclpy
    from action_msgs.msg import GoalStatus
    from geometry_msgs.msg import Twist
    from nav2_msgs.action import ComputePathToPose, FollowPath, NavigateToPose
    from nav_msgs.msg import OccupancyGrid
    from nav_msgs.msg import Path as PathMessage
    from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
    from rclpy.clock import Clock, ClockType
    from rclpy.executors import ExternalShutdownException
    from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
    from rclpy.node import Node
    from rclpy.task import Future

    from lupin_runtime import graph
    from lupin_runtime.ros.interfaces import interface
    from lupin_runtime.ros.node import qos_profile
    from lupin_runtime.ros.tf import to_message
    from lupin_runtime.transforms import Transform

    steady = Clock(clock_type=ClockType.STEADY_TIME)

    def checked(node: Any) -> Any:
        values = {name: each.value for name, each in node.get_parameters_by_prefix("").items()}
        plain = {name: list(value) if isinstance(value, (tuple, list)) else value for name, value in values.items()}
        declared = {name: value for name, value in plain.items() if name != "start_type_description_service"}
        if mistakes := parameter_mistakes(node.get_name(), declared):
            raise SystemExit("\n".join(mistakes))
        return node

    class StandIn(LifecycleNode):
        """A managed node, whose actions accept goals only while it is active."""

        def __init__(self, name: str) -> None:
            super().__init__(name, automatically_declare_parameters_from_overrides=True)
            self.is_active = False
            self.servers: list[Any] = []

        def serve(self, name: str, kind: Any, execute: Any, cancel: Any = lambda _: CancelResponse.ACCEPT) -> None:
            def accept(_: Any) -> GoalResponse:
                return GoalResponse.ACCEPT if self.is_active else GoalResponse.REJECT

            self.servers.append(ActionServer(self, kind, name, execute, goal_callback=accept, cancel_callback=cancel))

        async def found(self, client: Any) -> Any:
            """Return an action client once its server is there; what is sent before is lost."""
            is_there: Future = Future(executor=self.executor)

            def look() -> None:
                if client.server_is_ready():
                    timer.cancel()
                    is_there.set_result(None)

            timer = self.create_timer(0.02, look, clock=steady)
            await is_there
            return client

        def on_configure(self, state: Any) -> TransitionCallbackReturn:
            """Create what the program serves."""
            self.configure()
            return super().on_configure(state)

        def on_activate(self, state: Any) -> TransitionCallbackReturn:
            """Accept goals from now on."""
            self.is_active = True
            return super().on_activate(state)

        def configure(self) -> None:
            """Create what the program serves; nothing by default."""

    class Controller(StandIn):
        def configure(self) -> None:
            self.output = self.create_publisher(Twist, "cmd_vel", 1)
            self.serve("follow_path", FollowPath, self.follow)

        async def follow(self, goal: Any) -> Any:
            far = goal.request.path.poses[-1].pose.position.x > FAR_M
            ended: Future = Future(executor=self.executor)
            sent = 0

            def send() -> None:
                nonlocal sent
                sent += 1
                if goal.is_cancel_requested or (sent > VELOCITIES_OF_NEAR_GOAL and not far):
                    self.output.publish(Twist())
                    timer.cancel()
                    ended.set_result(None)
                    return
                velocity = Twist()
                velocity.linear.x = 0.2
                self.output.publish(velocity)

            timer = self.create_timer(0.05, send, clock=steady)
            await ended
            (goal.canceled if goal.is_cancel_requested else goal.succeed)()
            return FollowPath.Result()

    class Planner(StandIn):
        def configure(self) -> None:
            self.serve("compute_path_to_pose", ComputePathToPose, self.plan)

        async def plan(self, goal: Any) -> Any:
            goal.succeed()
            return ComputePathToPose.Result(path=PathMessage(header=goal.request.goal.header, poses=[goal.request.goal]))

    class Navigator(StandIn):
        def configure(self) -> None:
            self.planner = ActionClient(self, ComputePathToPose, "compute_path_to_pose")
            self.controller = ActionClient(self, FollowPath, "follow_path")
            self.following: Any = None
            self.serve("navigate_to_pose", NavigateToPose, self.navigate, self.cancel)

        async def navigate(self, goal: Any) -> Any:
            planner, controller = await self.found(self.planner), await self.found(self.controller)
            self.get_logger().info("planning")
            planning = await planner.send_goal_async(ComputePathToPose.Goal(goal=goal.request.pose))
            planned = await planning.get_result_async()
            self.following = await controller.send_goal_async(FollowPath.Goal(path=planned.result.path))
            self.get_logger().info("following")
            followed = await self.following.get_result_async()
            if goal.is_cancel_requested:
                goal.canceled()
            else:  # what it does may be canceled before itself
                (goal.succeed if followed.status == GoalStatus.STATUS_SUCCEEDED else goal.abort)()
            return NavigateToPose.Result()

        def cancel(self, _: Any) -> CancelResponse:
            if self.following is not None:
                self.following.cancel_goal_async()
            return CancelResponse.ACCEPT

    class Mapper(StandIn):
        def configure(self) -> None:
            self.output = self.create_publisher(OccupancyGrid, graph.MAP.name, qos_profile(graph.LATCHED1))
            self.tf = self.create_publisher(interface(graph.TF.type), graph.TF.name, qos_profile(graph.TF.qos))
            self.create_timer(0.05, self.publish, clock=steady)

        def publish(self) -> None:
            if not self.is_active:
                return
            grid = OccupancyGrid(data=[0] * 10_000)
            grid.header.frame_id = graph.MAP_FRAME
            grid.info.resolution, grid.info.width, grid.info.height = 0.1, 100, 100
            self.output.publish(grid)
            stamped = to_message(graph.MAP_FRAME, graph.ODOM_FRAME, self.get_clock().now().nanoseconds, Transform())
            self.tf.publish(interface(graph.TF.type)(transforms=[stamped]))

    rclpy.init(args=sys.argv)
    kinds = {"controller_server": Controller, "planner_server": Planner, "bt_navigator": Navigator, "slam_toolbox": Mapper}
    name = "slam_toolbox" if executable == "async_slam_toolbox_node" else executable
    costmap = {"controller_server": "local_costmap", "planner_server": "global_costmap"}.get(name)
    if costmap is not None:
        checked(Node(costmap, namespace=costmap, automatically_declare_parameters_from_overrides=True))
    with suppress(ExternalShutdownException):
        rclpy.spin(checked(kinds.get(name, StandIn)(name)))


if __name__ == "__main__":
    main(sys.argv[1])
