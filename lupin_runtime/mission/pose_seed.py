"""The node `seed_amcl_pose`: publishes the pose that AMCL would publish, while SLAM localizes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped

from lupin_runtime import graph
from lupin_runtime.localization import PLANAR_VARIANCES
from lupin_runtime.mission.adapters import STALE_TRANSFORM_S
from lupin_runtime.mission.robot_pose import PolledTransform
from lupin_runtime.ros import LupinNode, stamp_from_ns

MIN_RATE_HZ = 0.1


class PoseSeed(LupinNode):
    """Publishes SLAM's pose of the robot on `/amcl_pose`, at 1 Hz and latched.

    The variance is small while transforms arrive; when they stop, it grows with the distance that the robot may have driven
    since. Parameters: `pose_topic`, `frame_id`, `base_frame`, `rate_hz` (1.0), `variance` (0.01), `stale_after_s` (2.0).
    """

    MAX_SPEED_M_S = 0.5

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("seed_amcl_pose", parameters)
        self._frame = self.parameter("frame_id", graph.MAP_FRAME)
        self._variance = self.parameter("variance", 0.01)
        self._stale_after_s = self.parameter("stale_after_s", STALE_TRANSFORM_S)
        self._robot = PolledTransform(self, self._frame, self.parameter("base_frame", graph.BASE_FRAME))
        self._poses = self.publisher(replace(graph.AMCL_POSE, name=self.parameter("pose_topic", graph.AMCL_POSE.name)))
        self.create_timer(1.0 / max(MIN_RATE_HZ, self.parameter("rate_hz", 1.0)), self._publish)

    def _publish(self) -> None:
        found = self._robot.lookup()
        if found is None:
            return  # SLAM has not localized yet
        transform, age_s = found
        variance = self._variance
        if age_s > self._stale_after_s:
            variance = max(variance, (self.MAX_SPEED_M_S * age_s) ** 2)
            self.get_logger().warning(
                f"the robot's transform in {self._frame!r} is {age_s:.0f} s old: its pose gets a variance of {variance:.2f}",
                throttle_duration_sec=10.0,
            )
        message = PoseWithCovarianceStamped()
        message.header.stamp = stamp_from_ns(self.now_ns())
        message.header.frame_id = self._frame
        p, q = message.pose.pose.position, message.pose.pose.orientation
        p.x, p.y, p.z = transform.translation
        q.x, q.y, q.z, q.w = transform.rotation
        for index in PLANAR_VARIANCES:
            message.pose.covariance[index] = variance
        self._poses.publish(message)
