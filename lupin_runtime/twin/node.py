"""The node `lupin_twin`: receives observations, publishes the twin's state and serves fields."""

from __future__ import annotations

import math
from array import array
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Point32, Polygon, Pose
from lupin_msgs.msg import (
    DiscoveredTags,
    FlowerObservation,
    FlowerPoint,
    Observation,
    SensorReading,
    TwinState,
    TwinTagState,
)
from lupin_msgs.srv import GetField
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.perception.box_geometry import MalformedBoxes, read_boxes
from lupin_runtime.ros import LupinNode, stamp_from_ns, stamp_ns
from lupin_runtime.transforms import frame_name
from lupin_runtime.twin.field import FieldCache, FieldError, FieldRequest, IdwOptions, interpolate
from lupin_runtime.twin.store import PotFlowers, TagRecord, TwinFlower, TwinPose, TwinStore

DROP_WARNING_S = 30.0


class TwinNode(LupinNode):
    """Publishes the records of all tags at 1 Hz, and interpolates fields between them on request."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_twin", parameters)
        observations = str(self.parameter("observations_topic", graph.OBSERVATIONS.name))
        state = str(self.parameter("state_topic", graph.TWIN_STATE.name))
        field_service = str(self.parameter("field_service_name", graph.GET_FIELD.name))
        discovered = str(self.parameter("discovered_tags_topic", graph.DISCOVERED_TAGS.name))
        rate_hz = max(0.1, float(self.parameter("state_publish_rate_hz", 1.0)))
        self._frame = frame_name(str(self.parameter("frame_id", graph.MAP_FRAME)))
        self._store = TwinStore(int(self.parameter("buffer_len", 32)))
        self._idw = IdwOptions(
            float(self.parameter("idw_power", 2.0)),
            float(self.parameter("idw_falloff_radius_m", 1.5)),
            float(self.parameter("idw_max_distance_m", 1.5)),
        )
        self._fields = FieldCache()
        self._state = self.publisher(graph.Topic(state, graph.TWIN_STATE.type, graph.TWIN_STATE.qos))
        self.subscription(graph.Topic(observations, graph.OBSERVATIONS.type, graph.LATCHED50), self._on_observation)
        self.subscription(graph.Topic(discovered, graph.DISCOVERED_TAGS.type, graph.LATCHED1), self._on_discovered)
        self.subscription(graph.BOX_GEOMETRY, self._on_boxes)
        self.service(graph.Service(field_service, graph.GET_FIELD.type), self._get_field)
        self.create_timer(1.0 / rate_hz, self._publish)

    def _on_observation(self, message: Observation) -> None:
        if frame_name(message.header.frame_id) != self._frame:
            self._drop(f"frame {message.header.frame_id!r} is not {self._frame!r}")
            return
        pose = None
        if message.status == Observation.STATUS_OK:
            pose = _twin_pose(message.tag_pose_in_map)
        time_ns = self._time_ns(message)
        if message.kind == Observation.KIND_TAG_READING:
            reading = message.tag_reading
            if message.status == Observation.STATUS_OK:
                values = [(item.name, item.value) for item in reading.readings if item.name]
                accepted = self._store.add_reading(reading.tag_id, time_ns, values, pose)
            else:
                accepted = self._store.add_failure(reading.tag_id, time_ns, message.status_detail)
        elif message.kind == Observation.KIND_FLOWER:
            accepted = self._store.add_flowers(message.flower.tag_id, time_ns, _pot_flowers(message.flower), pose)
        else:
            self._drop(f"kind {message.kind} is unknown to the twin")
            return
        if not accepted:
            self._drop("its tag id is empty")

    def _drop(self, reason: str) -> None:
        self.get_logger().warning(f"observation dropped: {reason}", throttle_duration_sec=DROP_WARNING_S)

    def _time_ns(self, message: Observation) -> int:
        """Return the observation's stamp, or the current time if the stamp is missing or in the future."""
        now_ns, observed_ns = self.now_ns(), stamp_ns(message.header.stamp)
        return observed_ns if 0 < observed_ns <= now_ns else now_ns

    def _on_discovered(self, message: DiscoveredTags) -> None:
        if frame_name(message.header.frame_id) != self._frame:
            self.get_logger().warning(
                f"discovered tags dropped: frame {message.header.frame_id!r} is not {self._frame!r}",
                throttle_duration_sec=DROP_WARNING_S,
            )
            return
        for tag in message.tags:
            self._store.add_discovered(tag.tag_id, _twin_pose(tag.pose_in_map))

    def _on_boxes(self, message: String) -> None:
        try:
            boxes = read_boxes(message.data)
        except MalformedBoxes as error:
            self.get_logger().warning(f"box geometry dropped: {error}", throttle_duration_sec=DROP_WARNING_S)
            return
        for tag_id, box in boxes.items():
            self._store.add_box(tag_id, box.footprint())

    def _publish(self) -> None:
        now_ns = self.now_ns()
        message = TwinState()
        message.header.stamp = stamp_from_ns(now_ns)
        message.header.frame_id = self._frame
        message.tags = [_tag_state(record, now_ns) for record in self._store.records]
        self._state.publish(message)

    def _get_field(self, request: GetField.Request, response: GetField.Response) -> GetField.Response:
        field_request = FieldRequest(
            request.sensor_type,
            request.resolution,
            request.bbox_min_x,
            request.bbox_min_y,
            request.bbox_max_x,
            request.bbox_max_y,
        )
        try:
            field = self._fields.get(field_request, self._store.observation_count)
            if field is None:
                field = interpolate(field_request, self._store.samples(field_request.sensor), self._idw)
                self._fields.put(field_request, self._store.observation_count, field)
        except FieldError as error:
            response.ok, response.error_message = False, str(error)
            return response
        response.ok = True
        values = array("f")
        values.frombytes(np.ascontiguousarray(field.values).tobytes())
        response.values = values
        response.width, response.height = field_request.width, field_request.height
        response.origin_x, response.origin_y = field_request.min_x, field_request.min_y
        response.resolution_used = field_request.resolution
        response.value_min, response.value_max = field.minimum, field.maximum
        response.sample_count = field.samples
        return response


def _twin_pose(pose: Pose) -> TwinPose:
    p, q = pose.position, pose.orientation
    return TwinPose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def _pot_flowers(message: FlowerObservation) -> PotFlowers:
    return PotFlowers(
        message.species,
        message.confidence,
        message.anomaly,
        message.flower_count,
        message.bug_count,
        tuple(
            TwinFlower((b.position.x, b.position.y, b.position.z), b.height_m, b.species, b.confidence, b.anomaly)
            for b in message.flowers
            if all(map(math.isfinite, (b.position.x, b.position.y, b.position.z)))
        ),
        tuple((point.x, point.y) for point in message.box_footprint.points),
    )


def _tag_state(record: TagRecord, now_ns: int) -> TwinTagState:
    state = TwinTagState(tag_id=record.tag_id)
    # The default Pose has w = 1, which would mean a known pose at the origin.
    state.pose.orientation.w = 0.0
    if record.pose is not None:
        p, q = state.pose.position, state.pose.orientation
        p.x, p.y, p.z = record.pose.position
        q.x, q.y, q.z, q.w = record.pose.orientation
    state.readings = [SensorReading(name=name, value=value) for name, value in record.readings.items()]
    if record.last_observed_ns is not None:
        state.last_observed = stamp_from_ns(record.last_observed_ns)
    state.stale_seconds = record.stale_s(now_ns)
    flowers = record.flowers
    state.species, state.species_confidence, state.anomaly = flowers.species, flowers.confidence, flowers.anomaly
    state.flower_count, state.bug_count = flowers.flower_count, flowers.bug_count
    state.flowers = [
        FlowerPoint(
            position=Point(x=b.position[0], y=b.position[1], z=b.position[2]),
            height_m=b.height_m,
            species=b.species,
            confidence=b.confidence,
            anomaly=b.anomaly,
        )
        for b in flowers.flowers
    ]
    state.box_footprint = Polygon(points=[Point32(x=x, y=y, z=0.0) for x, y in record.footprint])
    return state
