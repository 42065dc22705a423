"""The node `mission_orchestrator`: wires the orchestrator to the ROS graph."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter

from lupin_runtime import graph
from lupin_runtime.layout import Layout, LayoutError, load_layout
from lupin_runtime.localization import planar_variances
from lupin_runtime.mission.adapters import (
    ArmClient,
    ClimateBridgeClient,
    ConfirmTagClient,
    MapSource,
    NavigationClient,
    NodeClock,
)
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.messages import map_pose, observation_message, snapshot_message
from lupin_runtime.mission.orchestrator import Orchestrator
from lupin_runtime.mission.overrides import Override, OverridesFile
from lupin_runtime.mission.ports import Ports
from lupin_runtime.mission.records import ObservationRecord
from lupin_runtime.mission.requests import OperatorRequests, Reply
from lupin_runtime.ros import LupinNode
from lupin_runtime.safety.estop_subscription import subscribe_estop

WATCHDOG_HZ = 10.0
MIN_STATE_RATE_HZ = 0.1
SHUTDOWN_CANCEL_WAIT_S = 0.5

_REQUESTS: tuple[tuple[graph.Service, str, Callable[[OperatorRequests], Reply]], ...] = (
    (graph.MISSION_PAUSE, "pause", OperatorRequests.pause),
    (graph.MISSION_RESUME, "resume", OperatorRequests.resume),
    (graph.MISSION_ABORT, "abort", OperatorRequests.abort),
    (graph.MISSION_SKIP, "skip_current", OperatorRequests.skip_current),
    (graph.MISSION_DOCK, "dock", OperatorRequests.dock),
    (graph.MISSION_RESET, "reset", OperatorRequests.reset),
)


class MissionOrchestrator(LupinNode):
    """Implements the mission's ports. Its parameters are the fields of MissionConfig."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("mission_orchestrator", _convert_parameters(parameters or {}))
        self._config = config = self._read_parameters()
        # All callbacks run on the node's executor, but `before_shutdown` is called from another thread.
        self._lock = threading.RLock()
        self._state_is_new = False
        self._map_source = MapSource(self, config)
        self._navigation = NavigationClient(self, config, self._run_locked)
        ports = Ports(
            NodeClock(self),
            self._navigation,
            ClimateBridgeClient(self, replace(graph.GET_TAG_READING, name=config.bridge_service_name), self._run_locked),
            ConfirmTagClient(self, replace(graph.CONFIRM_TAG, name=config.visual_confirmation_service), self._run_locked),
            ArmClient(self, replace(graph.ARM_PRESET, name=config.arm_preset_service), self._run_locked),
            self._map_source,
            self,
        )
        self._states = self.publisher(graph.MISSION_STATE)
        self._observations = self.publisher(graph.OBSERVATIONS)
        self.orchestrator = Orchestrator(config, ports, self._load_layout(), self._load_overrides())
        self._navigation.listener = self.orchestrator
        self._subscribe()
        self._serve()
        self.create_timer(1.0 / WATCHDOG_HZ, lambda: self._run_locked(self.orchestrator.tick))
        self.create_timer(1.0 / max(MIN_STATE_RATE_HZ, config.state_publish_rate_hz), self._publish_state)
        self._publish_state()

    # -- parameters and files ------------------------------------------------------------------------------------------

    def _read_parameters(self) -> MissionConfig:
        values: dict[str, Any] = {}
        for field in fields(MissionConfig):
            if field.name == "tag_sequence":  # declared without a default: rclpy cannot infer the type of an empty list
                self.declare_parameter(field.name, Parameter.Type.STRING_ARRAY)
                given = self.get_parameter_or(field.name, Parameter(field.name, Parameter.Type.STRING_ARRAY, []))
                values[field.name] = list(given.value or [])
                continue
            default = list(field.default) if isinstance(field.default, tuple) else field.default
            values[field.name] = self.parameter(field.name, default)
        if values["map_yaml_path"]:
            self.get_logger().warning("parameter map_yaml_path is ignored: the map comes from the topic of map_topic")
        return MissionConfig.from_parameters(values)

    def _load_layout(self) -> Layout:
        path = self._config.tag_locations_file
        try:
            return load_layout(Path(path) if path else None)
        except LayoutError as error:
            self.get_logger().error(f"{error}; continuing without a layout: inspections know discovered tags only")
            return Layout()

    def _load_overrides(self) -> Mapping[str, Override]:
        path = self._config.approach_overrides_file
        if not path:
            return {}
        return OverridesFile(
            Path(path), lambda problem: self.get_logger().error(f"{problem}; continuing without changes of it")
        )

    # -- topics and services -------------------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        config, core = self._config, self.orchestrator

        def subscribe(row: graph.Topic, name: str, handle: Callable[[Any], None]) -> None:
            self.subscription(replace(row, name=name), lambda message: self._run_locked(lambda: handle(message)))

        subscribe_estop(
            self,
            lambda engaged: self._run_locked(lambda: core.on_estop(engaged)),
            replace(graph.ESTOP_STATE, name=config.estop_topic),
        )
        subscribe(graph.BATTERY, config.battery_topic, lambda m: core.on_battery(float(m.percentage)))
        subscribe(
            graph.AMCL_POSE,
            config.amcl_pose_topic,
            lambda m: core.on_pose(map_pose(m.pose.pose), planar_variances(m)),
        )
        subscribe(
            graph.DISCOVERED_TAGS,
            config.discovered_tags_topic,
            lambda m: core.on_tags({tag.tag_id: map_pose(tag.pose_in_map) for tag in m.tags}),
        )
        subscribe(graph.MAP, config.map_topic, self._map_source.on_map)

    def _serve(self) -> None:
        self.service(graph.MISSION_START, self._on_start)
        for row, name, method in _REQUESTS:
            self.service(row, partial(self._on_request, name, method))

    def _on_start(self, request: Any, response: Any) -> Any:
        def start() -> None:
            reply = self.orchestrator.requests.start(
                request.mission_type, list(request.tag_sequence), int(request.discovery_goal)
            )
            self._log_reply("start", reply)
            response.accepted, response.mission_id, response.error_message = (
                reply.success,
                reply.mission_id,
                reply.message,
            )

        self._run_locked(start)
        return response

    def _on_request(self, name: str, method: Callable[[OperatorRequests], Reply], _request: Any, response: Any) -> Any:
        def handle() -> None:
            reply = method(self.orchestrator.requests)
            self._log_reply(name, reply)
            response.success, response.message = reply.success, reply.message

        self._run_locked(handle)
        return response

    def _log_reply(self, request: str, reply: Reply) -> None:
        text = f"{request}: {reply.message or reply.mission_id}"
        if reply.success:
            self.get_logger().info(text)
        else:
            self.get_logger().warning(f"{text} (refused)")

    def _run_locked(self, callback: Callable[[], None]) -> None:
        """Run a callback under the lock, and publish the state if the callback changed it."""
        with self._lock:
            callback()
            if self._state_is_new:
                self._publish_state()

    def _publish_state(self) -> None:
        with self._lock:
            self._state_is_new = False
            self._states.publish(snapshot_message(self.orchestrator.snapshot(), self.now_ns(), self._config.frame_id))

    # -- MissionPublisher ----------------------------------------------------------------------------------------------

    def publish_observation(self, record: ObservationRecord) -> None:
        """Publish an observation."""
        self._observations.publish(observation_message(record, self.now_ns(), self._config.frame_id))

    def state_changed(self) -> None:
        """Publish the state when the current callback ends."""
        self._state_is_new = True

    def log(self, text: str, warning: bool = False) -> None:
        """Write a log line."""
        if warning:
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)

    def before_shutdown(self) -> None:
        """Cancel the current goal, and wait up to SHUTDOWN_CANCEL_WAIT_S for navigation to confirm."""
        with self._lock:
            self.orchestrator.shut_down()
        deadline = time.monotonic() + SHUTDOWN_CANCEL_WAIT_S
        while self.orchestrator.mission_runner.goal_runner.cancelling and time.monotonic() < deadline:
            time.sleep(0.02)


def _convert_parameters(parameters: dict[str, Any]) -> dict[str, Any]:
    """Convert integers to floats for parameters with a float default, since ROS fixes a type at declaration.

    Raises BadParameter for unknown names and unusable values."""
    floats = {field.name for field in fields(MissionConfig) if isinstance(field.default, float)}
    converted: dict[str, Any] = {}
    for name, value in parameters.items():
        if name in floats and isinstance(value, int) and not isinstance(value, bool):
            converted[name] = float(value)
        elif name == "dock_pose":
            converted[name] = [float(number) for number in value]
        elif name == "tag_sequence" and not value:
            continue
        else:
            converted[name] = list(value) if isinstance(value, tuple) else value
    # rclpy silently ignores parameters that the node does not declare, so misspelled names are rejected here.
    MissionConfig.from_parameters(converted)
    return converted
