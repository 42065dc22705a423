"""The node `bt_navigator`: the executive on the graph, behind Nav2's names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.actions import NavigationServer, PathServer, UnusableGoal
from lupin_runtime.navigation.costmap import BeamPoses, Costmap, GlobalCostmap, LocalCostmap
from lupin_runtime.navigation.decision import Decision, Failure, View
from lupin_runtime.navigation.executive import Executive
from lupin_runtime.navigation.messages import (
    costmap_message,
    goal_markers,
    map_from_message,
    path_message,
    pose_from_message,
    raw_costmap_message,
    twist_message,
)
from lupin_runtime.navigation.mppi import MppiController
from lupin_runtime.navigation.parameters import declare_parameters
from lupin_runtime.navigation.plan_worker import PlanWorker
from lupin_runtime.navigation.recoveries import STANDSTILL
from lupin_runtime.navigation.robot_state import RobotState
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.lifecycle import serve_state
from lupin_runtime.ros.node import qos_profile
from lupin_runtime.ros.plane_messages import plane_pose_message
from lupin_runtime.safety.estop_monitor import DRAIN_S, ESTOP_ENGAGED
from lupin_runtime.safety.estop_subscription import subscribe_estop
from lupin_runtime.transforms import TransformUnavailable, frame_name

# A late tick advances the node's clock by at most this, so that no timeout expires after a stall or a clock jump.
_LONGEST_TICK_S = 0.5

# /plan is for display only: a point every 10 cm is enough.
_PLAN_STRIDE = 2


class Navigator(LupinNode):
    """Connects costmaps, planner, controller and recoveries to the graph.

    While the e-stop is engaged every goal, of any client, is aborted with that reason. Its release starts nothing. With the
    parameter `wait_for_estop`, no goal moves the robot before the e-stop's state and status are known: a new process might
    accept a goal that is older than a release it has not heard of.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("bt_navigator", parameters)
        values = self._parameter_values = declare_parameters(self)
        self._estop_engaged = False
        # What has to arrive before the first goal moves the robot.
        estop_topics = (graph.ESTOP_STATE, graph.ESTOP_STATUS) if self.parameter("wait_for_estop", False) else ()
        self._estop_unknown = {topic.name for topic in estop_topics}
        self._released_ns: int | None = None
        self._elapsed_s = 0.0
        self._last_tick_ns: int | None = None
        self._silent = True
        self._closing = False
        self._feedback_due_s = 0.0

        self._local = LocalCostmap(
            values.local_costmap.width, values.local_costmap.resolution, values.inflation, values.local_costmap.limits()
        )
        self._worker = PlanWorker(GlobalCostmap(values.inflation, values.global_costmap.limits()), values.planner)
        self._robot_state = RobotState(
            self,
            self._local,
            lambda: self._elapsed_s,
            values.transform_timeout_s,
            values.scan_timeout_s,
            values.velocity_threshold,
        )
        self._executive = Executive(
            self._worker,
            MppiController(values.mppi),
            values.executive,
            clear_local=self._local.clear,
            log=lambda text: self.get_logger().warning(text),
        )
        self._servers = NavigationServer(self, self._locate, self._start, self._stop_now)
        self._paths = PathServer(
            self, self._locate, self._robot_state.map_from_base, self._worker.submit, lambda: self._elapsed_s
        )
        self._twist_out = self.publisher(graph.CMD_VEL_NAV)
        self._plan_out = self.publisher(graph.PLAN)
        self._goals_out = self.publisher(graph.GOAL_MARKERS)
        self._local_out = self.publisher(graph.LOCAL_COSTMAP)
        self._global_out = self.publisher(graph.GLOBAL_COSTMAP)
        self.subscription(graph.MAP, self._on_map, raw=True)
        subscribe_estop(self, self._on_estop)
        for topic in estop_topics:  # subscribed after subscribe_estop, which therefore handles the same message first
            self.subscription(topic, partial(self._note_estop_known, topic.name))
        self.subscription(graph.GOAL_POSE, self._on_goal_pose)
        self.service(graph.CLEAR_LOCAL_COSTMAP, self._clear_local)
        self.service(graph.CLEAR_GLOBAL_COSTMAP, self._clear_global)
        self.service(graph.GET_LOCAL_COSTMAP, self._get_local)
        # A group of its own: while a callback waits, nothing else of its group is called, and the control loop must be.
        self.service(graph.GET_GLOBAL_COSTMAP, self._get_global, ReentrantCallbackGroup())
        self._snapshot: Future | None = None
        self._active = False
        serve_state(self, graph.BT_NAVIGATOR_STATE, lambda: self._active and not self._closing)
        self._self_client: Any = None
        self._clicked_goal: tuple[PoseStamped, float] | None = None

        self.create_timer(1.0 / values.mppi.controller_frequency, self._control)
        self.create_timer(1.0 / values.local_costmap.update_frequency, self._update_local)
        self.create_timer(1.0 / values.global_costmap.update_frequency, self._update_global)
        self.create_timer(1.0 / values.local_costmap.publish_frequency, self._publish_local)
        self._recent: tuple[Any, BeamPoses] | None = None

    def publisher(self, topic: graph.Topic, qos: graph.Qos | None = None) -> Publisher:
        """Return a publisher without rclpy's default event handlers; see `subscription`."""
        events = PublisherEventCallbacks(use_default_callbacks=False)
        kind = interface(topic.type)
        return self.create_publisher(kind, topic.name, qos_profile(qos or topic.qos), event_callbacks=events)

    def subscription(
        self, topic: graph.Topic, callback: Callable[[Any], None], qos: graph.Qos | None = None, raw: bool = False
    ) -> Subscription:
        """Return a subscription without rclpy's default event handlers.

        These handlers only log QoS mismatches, which cannot occur between rows of one table, and each is one more entity in the
        wait set that this node builds a hundred times a second: they took a third of its CPU.
        """
        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        kind, profile = interface(topic.type), qos_profile(qos or topic.qos)
        return self.create_subscription(kind, topic.name, callback, profile, raw=raw, event_callbacks=events)

    def _note_estop_known(self, name: str, _: Any) -> None:
        self._estop_unknown.discard(name)

    # -- control -------------------------------------------------------------------------------------------------------
    def _control(self) -> None:
        self._advance_clock()
        self._apply_release()
        if self._worker.failure is not None:
            raise RuntimeError("the planner's thread crashed") from self._worker.failure
        self._note_active()
        self._paths.poll()
        self._forward_clicked_goal()
        if not self._servers.active or self._closing:
            return
        if self._servers.cancel_requested:
            self._end(None, "cancelled")
            return
        decision = self._executive.tick(self._view())
        if decision.new_path is not None and self._plan_out.get_subscription_count() > 0:
            self._plan_out.publish(path_message(decision.new_path, self._goal_yaw, self.now_ns(), _PLAN_STRIDE))
        if decision.finished:
            self._finish(decision)
            return
        self._drive(decision.velocity)
        if self._elapsed_s >= self._feedback_due_s:
            self._feedback_due_s = self._elapsed_s + 1.0 / self._parameter_values.feedback_hz
            here = self._robot_state.map_from_base()
            if here is not None:
                self._servers.feedback(here, self._executive.progress(self._elapsed_s))

    def _note_active(self) -> None:
        """Become active once both costmaps and the robot's pose are known, as Nav2's costmaps let its navigator do."""
        state = self._robot_state
        if not self._active and self._worker.has_map and state.local is not None and state.map_from_base() is not None:
            self._active = True
            self.get_logger().info("active: goals are driven")

    def _advance_clock(self) -> None:
        now_ns = self.elapsed_clock_ns()
        if self._last_tick_ns is not None:
            self._elapsed_s += min(max((now_ns - self._last_tick_ns) * 1e-9, 0.0), _LONGEST_TICK_S)
        self._last_tick_ns = now_ns

    def _view(self) -> View:
        state = self._robot_state
        return View(
            now_s=self._elapsed_s,
            odom_from_base=state.odom_from_base(),
            map_from_odom=state.map_from_odom(),
            velocity=state.velocity(),
            local=state.local,
            lidar_fault=state.lidar_fault(),
            scan_age_s=state.scan_age_s(),
            estop_known=not self._estop_unknown,
        )

    def _drive(self, velocity: tuple[float, float, float]) -> None:
        self._silent = False
        self._twist_out.publish(twist_message(*velocity))

    def _finish(self, decision: Decision) -> None:
        if decision.failure is None:
            self.get_logger().info("goal reached")
        else:
            self.get_logger().error(f"navigation aborted, {decision.failure.name}: {decision.reason}")
        self._end(decision.failure, decision.reason)

    def _end(self, failure: Any, reason: str) -> None:
        self._stop_now()
        self._goals_out.publish(goal_markers((), self.now_ns()))
        self._servers.finish(failure, reason)

    def _stop_now(self) -> None:
        """Publish zero velocity at once, not at the next tick; then publish nothing."""
        self._executive.stop()
        if not self._silent:
            self._drive(STANDSTILL)
            self._silent = True

    # -- goals ---------------------------------------------------------------------------------------------------------
    def _locate(self, message: PoseStamped) -> Pose2:
        """Transform a pose to the map frame; raises UnusableGoal with the reason if that is impossible."""
        try:
            pose = pose_from_message(message)
        except ValueError as error:
            raise UnusableGoal(Failure.INVALID_POSE, str(error)) from error
        frame = frame_name(message.header.frame_id)
        if frame in ("", graph.MAP_FRAME):
            return pose
        try:
            return self._robot_state.tree.lookup(graph.MAP_FRAME, frame).to_pose2() @ pose
        except TransformUnavailable as error:
            reason = f"a pose in frame {frame!r} cannot be transformed to {graph.MAP_FRAME!r}: {error}"
            raise UnusableGoal(Failure.NO_POSE, reason) from error

    def _start(self, poses: Sequence[Pose2]) -> None:
        self._goal_yaw = poses[-1].yaw
        self._feedback_due_s = self._elapsed_s
        self._executive.start(poses, self._elapsed_s)
        self._goals_out.publish(goal_markers(poses, self.now_ns()))
        if self._executive.estop_engaged:
            self._finish(self._executive.tick(self._view()))
            return
        last = poses[-1]
        self.get_logger().info(f"navigating through {len(poses)} pose(s) to ({last.x:.2f}, {last.y:.2f}, {last.yaw:.2f})")

    def _on_goal_pose(self, message: PoseStamped) -> None:
        try:
            pose = self._locate(message)
        except UnusableGoal as error:
            self.get_logger().error(f"{graph.GOAL_POSE.name} refused: {error}")
            return
        if self._executive.estop_engaged:
            self.get_logger().error(f"{graph.GOAL_POSE.name} refused: {ESTOP_ENGAGED}")
            return
        self._clicked_goal = plane_pose_message(pose, self.now_ns(), graph.MAP_FRAME), self._elapsed_s
        if self._self_client is None:
            # Sent to this node's own action, as in Nav2, so that cancelling all goals also cancels a clicked one.
            self._self_client = self.action_client(graph.NAVIGATE_TO_POSE)

    def _forward_clicked_goal(self) -> None:
        if self._clicked_goal is None:
            return
        pose, since_s = self._clicked_goal
        if self._self_client.server_is_ready():
            self._self_client.send_goal_async(interface(graph.NAVIGATE_TO_POSE.type).Goal(pose=pose))
            self._clicked_goal = None
        elif self._elapsed_s - since_s > 5.0:
            self.get_logger().error(f"{graph.GOAL_POSE.name} dropped: this node's own action server was not discovered")
            self._clicked_goal = None

    # -- map, costmaps, e-stop -----------------------------------------------------------------------------------------
    def _on_map(self, data: bytes) -> None:
        log = self.get_logger()
        self._worker.set_map(
            lambda: map_from_message(deserialize_message(data, OccupancyGrid)),
            lambda reason: log.error(f"{graph.MAP.name} refused: {reason}"),
        )

    def _on_estop(self, engaged: bool) -> None:
        if engaged == self._estop_engaged:
            return
        self._estop_engaged = engaged
        self._released_ns = None if engaged else self.monotonic_ns()
        if not engaged:
            return
        self._executive.set_estop(True)
        if self._clicked_goal is not None:
            self._clicked_goal = None
            self.get_logger().error(f"{graph.GOAL_POSE.name} dropped: {ESTOP_ENGAGED}")
        if self._servers.active and not self._closing:
            self._finish(self._executive.tick(self._view()))

    def _apply_release(self) -> None:
        """Release the executive once the goals that were queued before the release have been refused."""
        if self._released_ns is not None and self.monotonic_ns() - self._released_ns >= DRAIN_S * 1e9:
            self._released_ns = None
            self._executive.set_estop(False)

    def _update_local(self) -> None:
        taken = self._robot_state.update_local()
        if taken is not None:
            self._recent = taken

    def _update_global(self) -> None:
        correction = self._robot_state.map_from_odom()
        if self._recent is not None and correction is not None:
            scan, poses = self._recent
            self._worker.observe(scan, BeamPoses(correction @ poses.first, correction @ poses.last))
            self._recent = None
        if self._global_out.get_subscription_count() > 0:
            stamp_ns = self.now_ns()

            def publish(costmap: Costmap | None) -> None:
                if costmap is not None:
                    self._global_out.publish(costmap_message(costmap, graph.MAP_FRAME, stamp_ns))

            self._worker.snapshot(self._robot_state.map_from_base(), publish)

    def _publish_local(self) -> None:
        if self._robot_state.local is not None and self._local_out.get_subscription_count() > 0:
            self._local_out.publish(costmap_message(self._robot_state.local, graph.ODOM_FRAME, self.now_ns()))

    def _clear_local(self, _request: Any, response: Any) -> Any:
        self._local.clear()
        return response

    def _clear_global(self, _request: Any, response: Any) -> Any:
        self._worker.clear_obstacles()
        return response

    def _get_local(self, _request: Any, response: Any) -> Any:
        if self._robot_state.local is not None:
            response.map = raw_costmap_message(self._robot_state.local, graph.ODOM_FRAME, self.now_ns())
        return response

    async def _get_global(self, _request: Any, response: Any) -> Any:
        if self._snapshot is None or self._snapshot.done():  # requests that come together share one
            self._snapshot = self._request_snapshot()
        costmap = await self._snapshot
        if costmap is not None:
            response.map = raw_costmap_message(costmap, graph.MAP_FRAME, self.now_ns())
        return response

    def _request_snapshot(self) -> Future:
        found: Future = Future()

        def deliver(costmap: Costmap | None) -> None:
            found.set_result(costmap)
            if self.executor is not None:  # it may be waiting for something else than this thread
                self.executor.wake()

        self._worker.snapshot(self._robot_state.map_from_base(), deliver)
        return found

    # -- shutdown ------------------------------------------------------------------------------------------------------
    def before_shutdown(self) -> None:
        """Publish zero velocity and give the clients a result."""
        self._closing = True
        self._stop_now()
        self._servers.close()
        self._paths.close()
        self._worker.close()
