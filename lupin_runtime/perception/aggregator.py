"""Node `perception_aggregator`: fuses tag sightings into tags in the map, and flower detections into flowers in boxes."""

from __future__ import annotations

import math
from typing import Any

from geometry_msgs.msg import Point, Point32, Pose
from lupin_msgs.msg import DiscoveredTag, DiscoveredTags, FlowerObservation, FlowerPoint, MissionState, Observation
from lupin_msgs.srv import ConfirmTag
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.geometry import quaternion_from_yaw
from lupin_runtime.localization import planar_variances, says_lost
from lupin_runtime.perception.box_geometry import Box, BoxSize, MalformedBoxes, box_from_tag, read_boxes
from lupin_runtime.perception.color_blobs import CLASS_NAMES
from lupin_runtime.perception.flowers import Accumulator, FlowerOptions, PotObservation
from lupin_runtime.perception.map_jumps import MapMotion
from lupin_runtime.perception.markers import ChangedMarkers, box_markers, tag_markers
from lupin_runtime.perception.messages import MalformedDetections, SeenTag, read_flower_detections, read_tags
from lupin_runtime.perception.passive_observer import PassiveObserver
from lupin_runtime.perception.pose_messages import transform_pose_message
from lupin_runtime.perception.registry import KnownTag, Sighting, TagRegistry
from lupin_runtime.perception.tag_tree import TagTransform, TagTree
from lupin_runtime.ros import LupinNode, TransformListener, stamp_from_ns
from lupin_runtime.transforms import Transform, TransformUnavailable

CLOCK_STEP_NS = 1_000_000_000
SCANNING_STATES = ("INSPECTING", "MONITORING")


class PerceptionAggregator(LupinNode):
    """Fuses tag sightings in the map, answers whether a tag is in view, and reports the flowers of the pot in focus."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("perception_aggregator", parameters)
        self._declare()
        self._tree = TagTree(self._prefix, self.elapsed_clock_ns)
        self._listener = TransformListener(self, self._tree)
        self._registry = TagRegistry(self._min_sightings)
        self._motion = MapMotion()
        self._map_from_odom: Transform | None = None
        self._lost = False
        self._newest_ns = 0
        self._accumulator = Accumulator(self._options)
        self._last_flowers: dict[str, PotObservation] = {}
        self._boxes: dict[str, Box] = {}
        self._mission: MissionState | None = None
        self._last_frame: list[SeenTag] = []
        self._last_frame_ns: int | None = None
        self._seen_ids: set[str] = set()
        self._observer = PassiveObserver(self) if bool(self.parameter("passive_observer", False)) else None

        row = graph.Topic
        self._discovered = self.publisher(row(self._topics["discovered_tags"], graph.DISCOVERED_TAGS.type, graph.LATCHED1))
        self._observations = self.publisher(row(self._topics["observations"], graph.OBSERVATIONS.type, graph.LATCHED50))
        self._tag_markers = ChangedMarkers(self.publisher(graph.TAG_MARKERS).publish, self._map_frame)
        self._box_markers = ChangedMarkers(self.publisher(graph.BOX_MARKERS).publish, self._map_frame)
        detections = graph.TAG_DETECTIONS
        self.subscription(row(self._topics["tag_detections"], detections.type, detections.qos), self._on_tags)
        self.subscription(row(self._topics["yolo_detections"], detections.type, detections.qos), self._on_flower_detections)
        self.subscription(row(self._topics["mission_state"], graph.MISSION_STATE.type, graph.LATCHED1), self._on_mission)
        self.subscription(row(self._topics["amcl_pose"], graph.AMCL_POSE.type, graph.AMCL_POSE.qos), self._on_pose)
        self.subscription(row(self._topics["box_geometry"], graph.BOX_GEOMETRY.type, graph.LATCHED1), self._on_boxes)
        # Fifty messages a second for one joint angle that is needed a few times a minute: they are deserialized only then.
        joints = row(self._topics["joint_states"], graph.JOINT_STATES.type, graph.BEST1)
        self._joint_bytes: bytes | None = None
        self.subscription(joints, self._on_joint_bytes, raw=True)
        self.service(graph.Service(str(self._confirm_service), graph.CONFIRM_TAG.type), self._confirm)
        self.create_timer(1.0 / self._rate_hz, self._publish)

    def _declare(self) -> None:
        p = self.parameter
        self._topics = {
            "tag_detections": str(p("tag_detections_topic", graph.TAG_DETECTIONS.name)),
            "yolo_detections": str(p("yolo_detections_topic", graph.FLOWER_DETECTIONS.name)),
            "amcl_pose": str(p("amcl_pose_topic", graph.AMCL_POSE.name)),
            "mission_state": str(p("mission_state_topic", graph.MISSION_STATE.name)),
            "box_geometry": str(p("box_geometry_topic", graph.BOX_GEOMETRY.name)),
            "discovered_tags": str(p("discovered_tags_topic", graph.DISCOVERED_TAGS.name)),
            "observations": str(p("observations_topic", graph.OBSERVATIONS.name)),
            "joint_states": str(p("joint_states_topic", graph.JOINT_STATES.name)),
        }
        self._confirm_service = p("confirm_service", graph.CONFIRM_TAG.name)
        self._map_frame = str(p("map_frame", graph.MAP_FRAME))
        self._odom_frame = str(p("odom_frame", graph.ODOM_FRAME))
        self._base_frame = str(p("base_frame", graph.BASE_FRAME))
        self._prefix = str(p("tf_frame_prefix", graph.TAG_FRAME_PREFIX))
        self._min_sightings = int(p("min_sightings", 3))
        self._max_distance_m = float(p("max_tag_distance_m", 2.5))
        self._freshness_s = float(p("freshness_s", 5.0))
        self._focus_window_s = float(p("yolo_window_s", 2.0))
        self._box_size = BoxSize(float(p("box_width", 0.80)), float(p("box_depth", 0.40)), float(p("box_height", 0.30)))
        self._mount_height_m = float(p("tag_mount_height", 0.10))
        self._lateral_offset_m = float(p("tag_lateral_offset", 0.0))
        self._pan_joint = str(p("pan_joint_name", graph.ARM_JOINTS[0]))
        self._rate_hz = max(0.2, float(p("publish_rate_hz", 2.0)))
        self._options = FlowerOptions(
            class_names=tuple(p("flower_class_names", list(CLASS_NAMES))),
            anomaly_class_name=str(p("anomaly_class_name", "bug")),
            min_confidence=float(p("yolo_min_confidence", 0.35)),
            image_width=float(p("detection_image_width", 640)),
            lateral_columns=max(1, int(p("lateral_columns", 7))),
            base_depth_frac=float(p("flower_base_depth_frac", 0.5)),
            depth_jitter_frac=float(p("flower_depth_jitter_frac", 0.18)),
            pan_half_span_rad=float(p("pan_half_span", 0.5)),
            camera_half_fov_rad=float(p("camera_half_fov", 0.5)),
            gate=bool(p("flower_box_gate", True)),
            gate_margin_m=float(p("flower_box_gate_margin_m", 0.10)),
        )

    # -- tags -------------------------------------------------------------------------------------------------------

    def _on_tags(self, message: String) -> None:
        try:
            seen = read_tags(message.data)
        except MalformedDetections as error:
            self.get_logger().warning(f"tag detections dropped: {error}", throttle_duration_sec=5.0)
            return
        now_ns = self.elapsed_clock_ns()
        self._last_frame, self._last_frame_ns = seen, now_ns
        for tag in seen:
            near = self._max_distance_m <= 0.0 or tag.dist_m <= self._max_distance_m
            if near:  # one that is too far away is ignored
                self._seen_ids.add(tag.id)
            self._tree.note_detection(tag.id, near)
        self._process_waiting()

    def _on_pose(self, message: Any) -> None:
        """Follow whether the robot is lost: then nothing that it sees is placed, and its way back moves no tag."""
        lost = says_lost(planar_variances(message))
        if lost != self._lost:
            self._lost = lost
            self._tree.clear()  # of the old place in the map
            self._map_from_odom = None
            self._motion.restart()
            if lost:
                self.get_logger().warning("the robot is lost: tags are not recorded until it is found")

    def _process_waiting(self) -> None:
        """Turn waiting transforms and detections into sightings, as far as the map's transforms have arrived."""
        self._check_clock()
        if self._lost:
            self._tree.waiting.clear()
            return
        self._follow_map()
        self._tree.pair(self._add_sighting)

    def _add_sighting(self, tag_id: str, transform: TagTransform) -> bool:
        """Add one sighting to the registry; False while a transform is missing.

        It uses odometry at the sighting's stamp and the newest map correction: a SLAM that dates its correction ahead would
        otherwise place the first sightings after a jump by the old map.
        """
        try:
            if self._map_from_odom is not None:
                odom_from_camera = self._tree.lookup(self._odom_frame, transform.parent, transform.stamp_ns)
                map_from_camera = self._map_from_odom @ odom_from_camera
            else:
                map_from_camera = self._tree.lookup(self._map_frame, transform.parent, transform.stamp_ns)
        except TransformUnavailable:
            return False
        sighting = Sighting(
            transform.stamp_ns,
            map_from_camera @ transform.camera_from_tag,
            map_from_camera.translation,
            self._motion.traveled,
            self._motion.unrest_m,
        )
        self._registry.add(tag_id, sighting)
        return True

    def _follow_map(self) -> None:
        """Move known tags along with the map where SLAM has moved it."""
        try:
            map_from_odom = self._tree.lookup(self._map_frame, self._odom_frame)
            odom_from_base = self._tree.lookup(self._odom_frame, self._base_frame)
        except TransformUnavailable:
            return
        self._map_from_odom = map_from_odom
        time_s = self.elapsed_clock_ns() / 1e9
        jump = self._motion.update(time_s, map_from_odom.to_pose2(), odom_from_base.to_pose2())
        if jump is not None:
            self._registry.follow(jump)
            if jump.doubt_m == 0.0:
                self.get_logger().info("the map moved: known tags were moved with it", throttle_duration_sec=1.0)

    def _check_clock(self) -> None:
        """Drop transforms and stamps after the clock went back: they are in the future now."""
        now_ns = self.now_ns()
        if now_ns < self._newest_ns - CLOCK_STEP_NS:
            self.get_logger().warning("the clock went back: transforms are cleared, tags are kept")
            self._tree.clear()
            self._tree.waiting.clear()
            self._map_from_odom = None
            self._last_frame_ns = None
            self._registry.forget_times()
            self._newest_ns = now_ns
        self._newest_ns = max(self._newest_ns, now_ns)

    def _publish(self) -> None:
        self._process_waiting()
        message = DiscoveredTags()
        message.header.stamp = stamp_from_ns(self.now_ns())
        message.header.frame_id = self._map_frame
        for tag in self._registry.discovered():
            found = self._last_flowers.get(tag.id, PotObservation())
            message.tags.append(
                DiscoveredTag(
                    tag_id=tag.id,
                    pose_in_map=transform_pose_message(tag.pose),
                    species=found.species,
                    species_confidence=found.confidence,
                    anomaly=found.anomaly,
                    sightings=tag.sightings,
                )
            )
        self._discovered.publish(message)
        self._publish_markers(message)
        self._refocus()
        if self._seen_ids and len(self._registry) == 0:
            self.get_logger().warning(
                f"tags {', '.join(sorted(self._seen_ids))} are detected but none can be placed: "
                f"is there a transform {self._map_frame} -> {self._prefix}<id>, and a camera_info?",
                throttle_duration_sec=10.0,
            )
        if self._observer is not None:
            self._observer.tick(self._mission, self._registry.discovered())

    def _publish_markers(self, message: DiscoveredTags) -> None:
        tags = {tag.id: tag for tag in self._registry.discovered()}
        boxes = {name: box for name, tag in tags.items() if (box := self._box(name, tag)) is not None}
        stamp = message.header.stamp
        poses = {name: (*tag.pose.translation, *tag.pose.rotation) for name, tag in tags.items()}
        self._tag_markers.update(poses, lambda: tag_markers(message.tags), stamp)
        corners = {name: (*box.origin, *box.normal, box.size.width, box.size.depth) for name, box in boxes.items()}
        self._box_markers.update(corners, lambda: box_markers(boxes), stamp)

    def _confirm(self, request: ConfirmTag.Request, response: ConfirmTag.Response) -> ConfirmTag.Response:
        self._process_waiting()
        now_ns = self.now_ns()
        tag = self._registry.get(request.expected_tag_id)
        problem = self._registry.doubt(request.expected_tag_id, now_ns, self._freshness_s)
        seen = self._registry.sightings(request.expected_tag_id)
        response.detected = problem is None
        response.detection_confidence = min(1.0, seen / self._registry.min_sightings)
        response.error_message = problem or ""
        # w = 0 means "no pose"; the default of a Pose has w = 1, a pose at the origin.
        response.tag_pose_in_map.orientation.w = 0.0
        if problem is None and tag is not None:
            response.tag_pose_in_map = transform_pose_message(tag.pose)
        return response

    # -- flowers ----------------------------------------------------------------------------------------------------

    def _on_mission(self, message: MissionState) -> None:
        self._mission = message
        self._refocus()

    def _on_joint_bytes(self, data: bytes) -> None:
        self._joint_bytes = data

    def _pan_rad(self) -> float:
        """The arm's pan angle, 0 until it is known."""
        if self._joint_bytes is None:
            return 0.0
        message: JointState = deserialize_message(self._joint_bytes, JointState)
        angle = dict(zip(message.name, message.position)).get(self._pan_joint, 0.0)
        return float(angle) if math.isfinite(angle) else 0.0

    def _on_boxes(self, message: String) -> None:
        try:
            self._boxes = read_boxes(message.data)
        except MalformedBoxes as error:
            self.get_logger().warning(f"box geometry dropped: {error}", throttle_duration_sec=5.0)

    def _on_flower_detections(self, message: String) -> None:
        try:
            seen = read_flower_detections(message.data)
        except MalformedDetections as error:
            self.get_logger().warning(f"flower detections dropped: {error}", throttle_duration_sec=5.0)
            return
        self._refocus()
        # The joint's angle is positive to the left, image columns count to the right.
        self._accumulator.add(seen, -self._pan_rad(), 0.0)
        self._report()

    def _refocus(self) -> None:
        self._accumulator.focus(self._focus())

    def _focus(self) -> str | None:
        """The tag whose pot is in focus."""
        mission = self._mission
        if mission is not None and mission.lifecycle_state:
            scanning = mission.lifecycle_state in SCANNING_STATES and mission.mission_phase == "SCANNING"
            return mission.current_target or None if scanning else None
        if self._last_frame_ns is None or self.elapsed_clock_ns() - self._last_frame_ns > self._focus_window_s * 1e9:
            return None
        nearest = min(self._last_frame, key=lambda tag: tag.dist_m, default=None)
        return nearest.id if nearest is not None else None

    def _report(self) -> None:
        """Publish the flowers of the pot in focus, if they differ from what was published last."""
        target = self._accumulator.target
        if target is None:
            return
        tag = self._registry.get(target)
        box, registered = self._box(target, tag), target in self._boxes
        anchor, height_m = self._anchor(box, registered, tag)
        observed = self._accumulator.observation(box, registered, (anchor.position.x, anchor.position.y))
        if not observed.differs_from(self._last_flowers.get(target)):
            return
        self._last_flowers[target] = observed
        self._observations.publish(self._observation(target, observed, box, anchor, height_m))

    def _box(self, tag_id: str, tag: KnownTag | None) -> Box | None:
        """The registered box of a tag, or else the one that its pose suggests."""
        box = self._boxes.get(tag_id)
        if box is not None or tag is None:
            return box
        return box_from_tag(tag.pose.translation, tag.pose.rotation, self._box_size, self._lateral_offset_m, self._robot())

    def _anchor(self, box: Box | None, registered: bool, tag: KnownTag | None) -> tuple[Pose, float]:
        """The pose of the pot, and the height of its flowers in meters."""
        if registered and box is not None:
            center = box.center()
            pose = Pose(position=Point(x=center.x, y=center.y, z=box.size.height))
            q = pose.orientation
            q.x, q.y, q.z, q.w = quaternion_from_yaw(center.yaw)
            return pose, box.size.height
        if tag is not None:
            height_m = max(0.0, tag.pose.translation[2] - self._mount_height_m + self._box_size.height)
            return transform_pose_message(tag.pose), height_m
        return Pose(), self._box_size.height

    def _observation(
        self, target: str, observed: PotObservation, box: Box | None, anchor: Pose, height_m: float
    ) -> Observation:
        stamp = stamp_from_ns(self.now_ns())
        flower = FlowerObservation(
            tag_id=target,
            species=observed.species,
            confidence=observed.confidence,
            anomaly=observed.anomaly,
            flower_count=min(observed.flower_count, 65535),
            bug_count=min(observed.bug_count, 65535),
        )
        flower.pose.header.stamp, flower.pose.header.frame_id = stamp, self._map_frame
        flower.pose.pose = anchor
        for placed in observed.flowers:
            point = FlowerPoint(species=placed.species, confidence=placed.confidence, anomaly=placed.anomaly, height_m=height_m)
            point.position.x, point.position.y = placed.position
            point.position.z = height_m
            flower.flowers.append(point)
        if box is not None:
            flower.box_footprint.points = [Point32(x=x, y=y, z=0.0) for x, y in box.footprint()]
        message = Observation(source="perception_aggregator", kind=Observation.KIND_FLOWER, flower=flower)
        message.header.stamp, message.header.frame_id = stamp, self._map_frame
        message.status = Observation.STATUS_OK
        if self._mission is not None:
            message.mission_id = self._mission.mission_id
        message.tag_pose_in_map.orientation.w = 0.0
        tag = self._registry.get(target)
        if tag is not None and tag.sightings >= self._min_sightings:
            message.tag_pose_in_map = transform_pose_message(tag.pose)
        return message

    def _robot(self) -> tuple[float, float] | None:
        try:
            x, y, _ = self._tree.lookup(self._map_frame, self._base_frame).translation
        except TransformUnavailable:
            return None
        return x, y
