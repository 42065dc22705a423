"""What the robot does in a run, for the views of its state: pose, way, plan, tags and a coarse map.

Nothing waits for these topics. The middleware keeps their newest messages, and a look at them twice a second takes those.
"""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.subscription import Subscription

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.robot_pose import PolledTransform
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.node import LupinNode, qos_profile
from lupin_runtime.ros.polled_subscription import PolledGroup, take_newest
from lupin_runtime.ros.stamps import stamp_ns
from lupin_runtime.stack.coarse_map import coarse_map

LOOK_PERIOD_S = 0.5
STALE_S = 3.0  # a pose or plan that nobody renews is not shown
MAX_TRAIL_POINTS, TRAIL_STEP_M = 300, 0.15
MAX_PLAN_POINTS, MAX_TAGS = 60, 200
MAX_STEP_M = 1.0  # in LOOK_PERIOD_S; a larger step is a correction of the pose, not a way
FACTOR_WINDOW_S = 5.0


class RobotTracker:
    """Follows the robot of a run on the supervisor's node. Call `look` often: it takes messages twice a second at most."""

    def __init__(self, node: LupinNode) -> None:
        """Subscribe on `node`, which need not spin for this."""
        self._pose = PolledTransform(node, graph.MAP_FRAME, graph.BASE_FRAME)
        group = PolledGroup()

        def poll(topic: graph.Topic) -> Subscription:
            return node.create_subscription(
                interface(topic.type),
                topic.name,
                lambda _: None,
                qos_profile(topic.qos),
                callback_group=group,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            )

        rows = (graph.MAP, graph.PLAN, graph.BATTERY, graph.CLOCK, graph.DISCOVERED_TAGS, graph.TWIN_STATE)
        self._subscriptions = {row.name: poll(row) for row in rows}
        self._looked_s = 0.0
        self._plan_s = -math.inf
        self._last: tuple[float, Pose2] | None = None
        self._clock: deque[tuple[float, float]] = deque()  # (wall, simulated) seconds
        self._tags: dict[str, dict[str, Any]] = {}
        self._trail: deque[list[float]] = deque(maxlen=MAX_TRAIL_POINTS)
        self._facts: dict[str, Any] = {"pose": None, "speed_m_s": None, "distance_m": 0.0, "tags": [], "plan": []}

    def look(self) -> dict[str, Any]:
        """Return what is known, as data for JSON: lengths in meters in the map frame, angles in radians, y up.

        `pose` is [x, y, yaw] or None; `map` has the rows of coarse cells, the first with the lowest y.
        """
        now_s = time.monotonic()
        if now_s - self._looked_s >= LOOK_PERIOD_S:
            self._looked_s = now_s
            self._look(now_s)
        return self._facts

    def _look(self, now_s: float) -> None:
        facts = dict(self._facts)
        self._follow_pose(facts, now_s)
        if (occupancy := self._newest(graph.MAP)) is not None and (drawn := coarse_map(occupancy)) is not None:
            facts["map"] = drawn
        if (plan := self._newest(graph.PLAN)) is not None:
            self._plan_s = now_s
            facts["plan"] = _points(plan.poses)
        elif now_s - self._plan_s > STALE_S:
            facts["plan"] = []
        if (battery := self._newest(graph.BATTERY)) is not None and math.isfinite(battery.percentage):
            facts["battery"] = round(battery.percentage, 3)
        if (clock := self._newest(graph.CLOCK)) is not None:
            facts["real_time_factor"] = self._real_time_factor(now_s, stamp_ns(clock.clock) / 1e9)
        self._follow_tags()
        facts["tags"] = list(self._tags.values())
        facts["trail"] = list(self._trail)
        self._facts = facts

    def _newest(self, topic: graph.Topic) -> Any:
        """Take what has arrived on a topic; return the newest message or None."""
        return take_newest(self._subscriptions[topic.name])

    def _follow_pose(self, facts: dict[str, Any], now_s: float) -> None:
        found = self._pose.lookup()
        if found is None or found[1] > STALE_S:
            facts["pose"] = facts["speed_m_s"] = self._last = None
            return
        pose = found[0].to_pose2()
        if self._last is not None:
            step_m = pose.distance_to(self._last[1])
            if step_m <= MAX_STEP_M:
                facts["distance_m"] = round(facts["distance_m"] + step_m, 3)
                facts["speed_m_s"] = round(step_m / (now_s - self._last[0]), 3)
        self._last = now_s, pose
        facts["pose"] = [round(pose.x, 3), round(pose.y, 3), round(pose.yaw, 3)]
        if not self._trail or math.dist(self._trail[-1], (pose.x, pose.y)) > TRAIL_STEP_M:
            self._trail.append([round(pose.x, 2), round(pose.y, 2)])

    def _follow_tags(self) -> None:
        """Note discovered tags with their place, and which of them have been read: both only grow."""
        discovered, twin = self._newest(graph.DISCOVERED_TAGS), self._newest(graph.TWIN_STATE)
        for tag in discovered.tags if discovered is not None else ():
            point = tag.pose_in_map.position
            if (known := self._tag(tag.tag_id)) is not None and math.isfinite(point.x) and math.isfinite(point.y):
                known["x"], known["y"] = round(point.x, 2), round(point.y, 2)
        for tag in twin.tags if twin is not None else ():
            if (known := self._tag(tag.tag_id)) is not None and tag.readings:
                known["read"] = True

    def _tag(self, tag_id: str) -> dict[str, Any] | None:
        if tag_id not in self._tags and len(self._tags) >= MAX_TAGS:
            return None
        return self._tags.setdefault(tag_id, {"id": tag_id[:20], "x": None, "y": None, "read": False})

    def _real_time_factor(self, wall_s: float, simulated_s: float) -> float | None:
        """Return simulated seconds per second over the last seconds; None before two messages of the clock."""
        if self._clock and simulated_s < self._clock[-1][1]:
            self._clock.clear()  # the simulator started again
        self._clock.append((wall_s, simulated_s))
        while len(self._clock) > 2 and wall_s - self._clock[0][0] > FACTOR_WINDOW_S:
            self._clock.popleft()
        first_wall_s, first_simulated_s = self._clock[0]
        return round((simulated_s - first_simulated_s) / (wall_s - first_wall_s), 3) if wall_s > first_wall_s else None


def _points(poses: Any) -> list[list[float]]:
    """Return at most MAX_PLAN_POINTS of a path's points, the last one among them."""
    points = [(pose.pose.position.x, pose.pose.position.y) for pose in poses]
    points = [point for point in points if all(map(math.isfinite, point))]
    step = max(1, math.ceil(len(points) / MAX_PLAN_POINTS))
    kept = points[::-1][::step][::-1]
    return [[round(x, 2), round(y, 2)] for x, y in kept]
