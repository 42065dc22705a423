"""`mission_orchestrator`, and `seed_amcl_pose`, which stands in for AMCL where SLAM localizes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.parameter import Parameter

from lupin_runtime import graph
from lupin_runtime.mission.adapters import (
    STALE_TRANSFORM_S,
    ArmClient,
    GateClient,
    GreenhouseClient,
    NavigationClient,
    NodeClock,
    RobotWorld,
)
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.layout import Layout, LayoutError, Override, load_layout, load_overrides
from lupin_runtime.mission.messages import (
    observation_message,
    planar_variances,
    snapshot_message,
    tag_pose,
)
from lupin_runtime.mission.orchestrator import Orchestrator, Reply
from lupin_runtime.mission.place import Place
from lupin_runtime.mission.ports import ObservationRecord, Ports
from lupin_runtime.ros import LupinNode, stamp_from_ns

WATCHDOG_HZ = 10.0
LOWEST_STATE_RATE_HZ = 0.1
LAST_CANCEL_WAIT_S = 0.5

_TRIGGERS: tuple[tuple[graph.Service, str], ...] = (
    (graph.MISSION_PAUSE, "pause"),
    (graph.MISSION_RESUME, "resume"),
    (graph.MISSION_ABORT, "abort"),
    (graph.MISSION_SKIP, "skip_current"),
    (graph.MISSION_DOCK, "dock"),
    (graph.MISSION_RESET, "reset"),
)


class MissionOrchestrator(LupinNode):
    """Wires an Orchestrator to the graph. Parameters: the fields of MissionConfig, under their names."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("mission_orchestrator", _with_declared_types(parameters or {}))
        self._config = config = self._read_parameters()
        # Everything runs on the node's executor, but the process's end is told from another thread.
        self._lock = threading.RLock()
        self._dirty = False
        self._world = RobotWorld(self, config)
        self._navigation = NavigationClient(self, config, self._guarded)
        ports = Ports(
            NodeClock(self),
            self._navigation,
            GreenhouseClient(self, replace(graph.GET_TAG_READING, name=config.bridge_service_name), self._guarded),
            GateClient(self, replace(graph.CONFIRM_TAG, name=config.visual_confirmation_service), self._guarded),
            ArmClient(self, replace(graph.ARM_PRESET, name=config.arm_preset_service), self._guarded),
            self._world,
            self,
        )
        self._states = self.publisher(graph.MISSION_STATE)
        self._observations = self.publisher(graph.OBSERVATIONS)
        self.orchestrator = Orchestrator(config, ports, self._load_layout(), self._load_overrides())
        self._navigation.listener = self.orchestrator
        self._subscribe()
        self._serve()
        self.create_timer(1.0 / WATCHDOG_HZ, lambda: self._guarded(self.orchestrator.tick))
        self.create_timer(1.0 / max(LOWEST_STATE_RATE_HZ, config.state_publish_rate_hz), self._publish_state)
        self._publish_state()

    # -- parameters and files ------------------------------------------------------------------------------------------

    def _read_parameters(self) -> MissionConfig:
        values: dict[str, Any] = {}
        for field in fields(MissionConfig):
            if field.name == "tag_sequence":  # unset by default: an empty list has no type of its own
                self.declare_parameter(field.name, Parameter.Type.STRING_ARRAY)
                given = self.get_parameter_or(field.name, Parameter(field.name, Parameter.Type.STRING_ARRAY, []))
                values[field.name] = list(given.value or [])
                continue
            default = list(field.default) if isinstance(field.default, tuple) else field.default
            values[field.name] = self.parameter(field.name, default)
        if values["map_yaml_path"]:
            self.get_logger().warning("parameter map_yaml_path is not used: the map comes from the graph")
        return MissionConfig.from_parameters(values)

    def _load_layout(self) -> Layout:
        path = self._config.tag_locations_file
        try:
            return load_layout(Path(path) if path else None)
        except LayoutError as error:
            self.get_logger().error(f"{error}; going on without a layout: inspections know discovered tags only")
            return Layout()

    def _load_overrides(self) -> Mapping[str, Override]:
        path = self._config.approach_overrides_file
        if not path:
            return {}
        try:
            return load_overrides(Path(path))
        except LayoutError as error:
            self.get_logger().error(f"{error}; going on without overrides")
            return {}

    # -- the graph -----------------------------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        config, core = self._config, self.orchestrator

        def hear(row: graph.Topic, name: str, act: Callable[[Any], None]) -> None:
            self.subscription(replace(row, name=name), lambda message: self._guarded(lambda: act(message)))

        hear(graph.ESTOP_STATE, config.estop_topic, lambda m: core.heard_estop(bool(m.data)))
        hear(graph.BATTERY, config.battery_topic, lambda m: core.heard_battery(float(m.percentage)))
        hear(
            graph.AMCL_POSE,
            config.amcl_pose_topic,
            lambda m: core.heard_pose(tag_pose(m.pose.pose), planar_variances(m)),
        )
        hear(
            graph.DISCOVERED_TAGS,
            config.discovered_tags_topic,
            lambda m: core.heard_tags({tag.tag_id: tag_pose(tag.pose_in_map) for tag in m.tags}),
        )
        hear(graph.MAP, config.map_topic, self._world.heard_map)

    def _serve(self) -> None:
        self.service(graph.MISSION_START, self._on_start)
        for row, method in _TRIGGERS:
            self.service(row, partial(self._on_trigger, method))

    def _on_start(self, request: Any, response: Any) -> Any:
        def start() -> None:
            reply = self.orchestrator.start(request.mission_type, list(request.tag_sequence), int(request.discovery_goal))
            self._say("start", reply)
            response.accepted, response.mission_id, response.error_message = (
                reply.success,
                reply.mission_id,
                reply.message,
            )

        self._guarded(start)
        return response

    def _on_trigger(self, method: str, _request: Any, response: Any) -> Any:
        def act() -> None:
            reply: Reply = getattr(self.orchestrator, method)()
            self._say(method, reply)
            response.success, response.message = reply.success, reply.message

        self._guarded(act)
        return response

    def _say(self, request: str, reply: Reply) -> None:
        text = f"{request}: {reply.message or reply.mission_id}"
        if reply.success:
            self.get_logger().info(text)
        else:
            self.get_logger().warning(f"{text} (refused)")

    def _guarded(self, act: Callable[[], None]) -> None:
        """Act alone, and publish the state at once if it has changed."""
        with self._lock:
            act()
            if self._dirty:
                self._publish_state()

    def _publish_state(self) -> None:
        with self._lock:
            self._dirty = False
            self._states.publish(snapshot_message(self.orchestrator.snapshot(), self.now_ns(), self._config.frame_id))

    # -- the outlet of the core ----------------------------------------------------------------------------------------

    def observe(self, record: ObservationRecord) -> None:
        """Publish an observation."""
        self._observations.publish(observation_message(record, self.now_ns(), self._config.frame_id))

    def changed(self) -> None:
        """Publish the state when what is going on now is done."""
        self._dirty = True

    def log(self, text: str, warning: bool = False) -> None:
        """Say something to the log."""
        if warning:
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)

    def before_shutdown(self) -> None:
        """Leave no goal behind; waits a moment for navigation to hear it."""
        with self._lock:
            self.orchestrator.shut_down()
        deadline = time.monotonic() + LAST_CANCEL_WAIT_S
        while self.orchestrator.runner.ending and time.monotonic() < deadline:
            time.sleep(0.02)


def _with_declared_types(parameters: dict[str, Any]) -> dict[str, Any]:
    """Whole numbers where the default is a float: a parameter's type is fixed by its declaration."""
    floats = {field.name for field in fields(MissionConfig) if isinstance(field.default, float)}
    given: dict[str, Any] = {}
    for name, value in parameters.items():
        if name in floats and isinstance(value, int) and not isinstance(value, bool):
            given[name] = float(value)
        elif name == "dock_pose":
            given[name] = [float(number) for number in value]
        elif name == "tag_sequence" and not value:
            continue
        else:
            given[name] = list(value) if isinstance(value, tuple) else value
    # rclpy drops an override that nobody declares without a word, so a misspelt one is looked for here.
    MissionConfig.from_parameters(given)
    return given


class PoseSeed(LupinNode):
    """Publishes on `/amcl_pose` where SLAM has the robot, at 1 Hz and latched, with a variance that says how far to trust
    it: low while the transforms come, and growing with what the robot may have driven since once they stop.

    Parameters: `pose_topic`, `frame_id`, `base_frame`, `rate_hz` (1.0), `variance` (0.01), `stale_after_s` (2.0).
    """

    FASTEST_M_S = 0.5

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("seed_amcl_pose", parameters)
        self._frame = self.parameter("frame_id", graph.MAP_FRAME)
        self._variance = self.parameter("variance", 0.01)
        self._stale_after_s = self.parameter("stale_after_s", STALE_TRANSFORM_S)
        self._place = Place(self, self._frame, self.parameter("base_frame", graph.BASE_FRAME))
        self._poses = self.publisher(replace(graph.AMCL_POSE, name=self.parameter("pose_topic", graph.AMCL_POSE.name)))
        self.create_timer(1.0 / max(LOWEST_STATE_RATE_HZ, self.parameter("rate_hz", 1.0)), self._publish)

    def _publish(self) -> None:
        found = self._place.look()
        if found is None:
            return  # nobody knows yet: a pose is only vouched for once there was one
        transform, age_s = found
        variance = self._variance
        if age_s > self._stale_after_s:
            variance = max(variance, (self.FASTEST_M_S * age_s) ** 2)
            self.get_logger().warning(
                f"nobody has renewed the robot's transform in {self._frame!r} for {age_s:.0f} s: the pose is not vouched for",
                throttle_duration_sec=10.0,
            )
        message = PoseWithCovarianceStamped()
        message.header.stamp = stamp_from_ns(self.now_ns())
        message.header.frame_id = self._frame
        p, q = message.pose.pose.position, message.pose.pose.orientation
        p.x, p.y, p.z = transform.translation
        q.x, q.y, q.z, q.w = transform.rotation
        for index in (0, 7, 35):
            message.pose.covariance[index] = variance
        self._poses.publish(message)
