"""The QoS that the publishers of Nav2 1.3, slam_toolbox 2.8 and the packages beside them offer on topics that Lupin has too.

A subscriber that receives a topic from them receives it from Lupin as well if Lupin offers no less: reliable where they are,
and latched where they are. docs/interoperation.md shows the table, and a test compares it with `graph.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime import graph
from lupin_runtime.graph import Qos, Topic


@dataclass(frozen=True)
class UpstreamPublisher:
    """What another publisher of a topic offers; `why_less` says why Lupin offers less, where it does."""

    topic: Topic
    node: str
    qos: Qos
    why_less: str = ""

    @property
    def is_matched(self) -> bool:
        """Whether every subscription that fits the other publisher fits Lupin's."""
        ours = self.topic.qos
        return ours.reliable >= self.qos.reliable and ours.latched >= self.qos.latched


UPSTREAM: tuple[UpstreamPublisher, ...] = (
    UpstreamPublisher(graph.MAP, "slam_toolbox, nav2_map_server", graph.LATCHED1),
    UpstreamPublisher(graph.AMCL_POSE, "nav2_amcl", graph.LATCHED1),
    UpstreamPublisher(graph.PLAN, "nav2_planner", graph.REL1),
    UpstreamPublisher(graph.GLOBAL_COSTMAP, "nav2_costmap_2d", graph.LATCHED1),
    UpstreamPublisher(graph.LOCAL_COSTMAP, "nav2_costmap_2d", graph.LATCHED1),
    UpstreamPublisher(graph.CMD_VEL_NAV, "nav2_controller", graph.REL1),
    UpstreamPublisher(graph.CMD_VEL_AUTO, "nav2_velocity_smoother", graph.REL1),
    UpstreamPublisher(graph.TF, "tf2_ros", graph.REL100),
    UpstreamPublisher(graph.TF_STATIC, "tf2_ros", graph.LATCHED1),
    UpstreamPublisher(graph.ROBOT_DESCRIPTION, "robot_state_publisher", graph.LATCHED1),
    UpstreamPublisher(graph.JOINT_STATES, "joint_state_broadcaster", graph.REL10),
    UpstreamPublisher(graph.ODOM, "mecanum_drive_controller", graph.REL10),
    UpstreamPublisher(graph.ROSOUT, "rclpy, rclcpp", graph.REL100),
    UpstreamPublisher(graph.SCAN, "sllidar_ros2", graph.REL10, "as the robot's lidar driver, which offers sensor data QoS"),
    UpstreamPublisher(graph.CLOCK, "ros_gz_bridge", graph.REL10, "nodes subscribe to it best effort"),
    UpstreamPublisher(graph.CMD_VEL_SINK_ROBOT, "twist_mux", graph.REL10, "an old velocity must not be sent again"),
    UpstreamPublisher(graph.CMD_VEL_SINK_SIM, "twist_mux", graph.REL10, "an old velocity must not be sent again"),
)
