"""The nodes of perception on a real graph: from images to tags in the map and flowers in boxes."""

from __future__ import annotations

import json
import math
from array import array
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from lupin_runtime import graph
from lupin_runtime.localization import LOST_YAW_VARIANCE, PLANAR_VARIANCES
from tests.support.optional import present

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped
    from lupin_msgs.msg import DiscoveredTag, MissionState, Observation
    from lupin_msgs.srv import ConfirmTag_Response
    from sensor_msgs.msg import Image
    from std_msgs.msg import String

    from lupin_runtime.graph import Topic
    from lupin_runtime.perception.aggregator import PerceptionAggregator
    from lupin_runtime.perception.annotator import TagAnnotator
    from tests.conftest import GraphHost
    from tests.support.tag_views import View

pytestmark = pytest.mark.graph

TAG_ID = 41
STEP_NS = 100_000_000


class Bench:
    """Publishes images and the robot's transforms, and subscribes to the results."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode, TransformBroadcaster

        self.host = host
        self.node = LupinNode("bench")
        self.camera = self.node.publisher(graph.BODY_IMAGE_SIM)
        self.info = self.node.publisher(graph.camera_info(graph.BODY_IMAGE_SIM))
        self.gripper = self.node.publisher(graph.GRIPPER_IMAGE)
        self.tag_json = self.node.publisher(graph.TAG_DETECTIONS)
        self.flower_json = self.node.publisher(graph.FLOWER_DETECTIONS)
        self.mission = self.node.publisher(graph.MISSION_STATE)
        self.boxes = self.node.publisher(graph.BOX_GEOMETRY)
        self.tf = TransformBroadcaster(self.node)
        self.received: dict[str, list[Any]] = {}
        for row in (
            graph.TAG_DETECTIONS,
            graph.DISCOVERED_TAGS,
            graph.OBSERVATIONS,
            graph.TF,
            graph.FLOWER_DETECTIONS,
            graph.FLOWER_OVERLAY,
        ):
            self.received[row.name] = []
            self.node.subscription(row, self.received[row.name].append)
        self.confirm_client = self.node.client(graph.CONFIRM_TAG)
        self.time_ns = self.node.now_ns()
        host.add(self.node)

    def last(self, row: Topic) -> Any:
        return self.received[row.name][-1] if self.received[row.name] else None

    def wait_for_subscriptions(self, *publishers: Any, readers: int = 1) -> None:
        """Wait until the subscriptions of the nodes under test are matched."""
        for publisher in publishers:
            self.host.until(
                lambda p=publisher: p.get_subscription_count() >= readers,  # type: ignore[misc]
                what=f"a subscriber of {publisher.topic_name}",
            )

    def send_robot(
        self,
        map_from_odom: tuple[float, float, float] = (0.0, 0.0, 0.0),
        odom_from_base: tuple[float, float, float] = (0.0, 0.0, 0.0),
        stamp_ns: int | None = None,
    ) -> None:
        from lupin_runtime.geometry import quaternion_from_yaw
        from lupin_runtime.ros.tf import to_message
        from lupin_runtime.transforms import Transform

        stamp_ns = stamp_ns or self.time_ns
        self.tf.send(
            *(
                to_message(parent, child, stamp_ns, Transform((x, y, 0.0), quaternion_from_yaw(yaw)))
                for parent, child, (x, y, yaw) in (
                    ("map", "odom", map_from_odom),
                    ("odom", "base_link", odom_from_base),
                )
            )
        )

    def send_mount(self) -> None:
        """Publish the mount of the body camera, which faces ahead."""
        from lupin_runtime.ros.tf import to_message
        from lupin_runtime.transforms import Transform

        optical = (-0.5, 0.5, -0.5, 0.5)
        mount = Transform((0.15, 0.0, 0.14), optical)
        self.tf.send_static(to_message("base_link", graph.BODY_CAMERA_FRAME, self.time_ns, mount))

    def image(
        self, gray_or_color: np.ndarray, encoding: str = "mono8", frame: str = graph.BODY_CAMERA_FRAME, step: None = None
    ) -> Image:
        from sensor_msgs.msg import Image

        from lupin_runtime.ros import stamp_from_ns

        height, width = gray_or_color.shape[:2]
        data = array("B")
        data.frombytes(np.ascontiguousarray(gray_or_color).tobytes())
        channels = 1 if gray_or_color.ndim == 2 else gray_or_color.shape[2]
        message = Image(height=height, width=width, encoding=encoding, step=step or width * channels, data=data)
        message.header.stamp = stamp_from_ns(self.time_ns)
        message.header.frame_id = frame
        return message

    def send_info(self, k: np.ndarray | None = None) -> None:
        from sensor_msgs.msg import CameraInfo

        message = CameraInfo(width=640, height=480)
        message.k = [float(v) for v in (np.zeros(9) if k is None else np.ravel(k))]
        self.info.publish(message)

    def call_confirm(self, tag_id: str) -> ConfirmTag_Response:
        from lupin_msgs.srv import ConfirmTag

        self.host.until(self.confirm_client.service_is_ready, what="the confirm service")
        future = self.confirm_client.call_async(ConfirmTag.Request(expected_tag_id=tag_id))
        self.host.until(future.done, what="an answer")
        return future.result()

    def tag_transform(self, tag_id: int = TAG_ID) -> TransformStamped | None:
        name = f"tag_{tag_id}"
        found = [t for m in self.received[graph.TF.name] for t in m.transforms if t.child_frame_id == name]
        return found[-1] if found else None

    def send_tag(self, tag_id: int, position: tuple[float, float, float], yaw: float = math.pi, dist: None = None) -> None:
        """Publish, like the annotator, a tag at `position` in the base frame that faces along `yaw`."""
        from std_msgs.msg import String

        from lupin_runtime.ros.tf import to_message
        from lupin_runtime.transforms import Transform, multiply

        self.time_ns += STEP_NS
        self.send_robot(self.map_from_odom, self.odom_from_base)
        upright = multiply((0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), (0.5, 0.5, 0.5, 0.5))
        optical = Transform((0.15, 0.0, 0.14), (-0.5, 0.5, -0.5, 0.5))
        camera_from_tag = optical.inverse() @ Transform(position, upright)
        self.tf.send(to_message(graph.BODY_CAMERA_FRAME, f"tag_{tag_id}", self.time_ns, camera_from_tag))
        depth = camera_from_tag.translation[2] if dist is None else dist
        self.tag_json.publish(String(data=json.dumps([{"id": tag_id, "corners": [[0, 0]] * 4, "dist": depth}])))

    map_from_odom = (0.0, 0.0, 0.0)
    odom_from_base = (0.0, 0.0, 0.0)

    def discovered(self, tag_id: int, sightings: int = 1) -> DiscoveredTag:
        """Wait for a `discovered_tags` message with at least so many sightings of a tag; returns the tag."""

        def find() -> DiscoveredTag | None:
            message = self.last(graph.DISCOVERED_TAGS)
            tags = [t for t in message.tags if t.tag_id == str(tag_id)] if message else []
            return tags[0] if tags and tags[0].sightings >= sightings else None

        return self.host.until(find, what=f"tag {tag_id} with {sightings} sightings")


@pytest.fixture
def bench(graph_host: GraphHost) -> Any:
    return Bench(graph_host)


@pytest.fixture
def annotator(bench: Any, graph_host: GraphHost) -> TagAnnotator:
    from lupin_runtime.perception.node import TagAnnotator

    node = graph_host.add(TagAnnotator())
    bench.wait_for_subscriptions(bench.camera, bench.info)
    result: TagAnnotator = node
    return result


@pytest.fixture
def aggregator(bench: Any, graph_host: GraphHost) -> PerceptionAggregator:
    from lupin_runtime.perception.node import PerceptionAggregator

    node = graph_host.add(PerceptionAggregator({"publish_rate_hz": 20.0}))
    bench.send_mount()
    bench.wait_for_subscriptions(bench.tag_json, bench.flower_json, bench.mission, bench.boxes, bench.tf._moving, readers=1)
    # The bench subscribes to its own transforms, so the aggregator is the second reader.
    graph_host.until(lambda: bench.tf._moving.get_subscription_count() >= 2, what="the aggregator on /tf")
    graph_host.until(lambda: bench.last(graph.DISCOVERED_TAGS), what="a first message")
    result: PerceptionAggregator = node
    return result


def facing_view(
    tag_views: ModuleType, x: float = 0.1, y: float = -0.05, z: float = 0.9, azimuth: float = 0.2, tag_id: int = TAG_ID
) -> View:
    result: View = tag_views.render(tag_id, tag_views.tag_rotation(azimuth), np.array([x, y, z]), np.random.default_rng(1))
    return result


# -- annotator ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8", "rgba8", "bgra8"])
def test_image_gives_a_transform_and_json_at_its_stamp(
    bench: Any, annotator: TagAnnotator, tag_views: ModuleType, encoding: str
) -> None:
    view = facing_view(tag_views)
    shown = view.image
    if encoding != "mono8":
        shown = np.repeat(view.image[..., None], 3, axis=2)
        if encoding.endswith("a8"):
            shown = np.dstack([shown, np.full(view.image.shape, 255, np.uint8)])
    bench.send_info(tag_views.CAMERA)
    bench.host.until(lambda: annotator._info is not None)
    bench.camera.publish(bench.image(shown, encoding))
    transform = bench.host.until(bench.tag_transform)
    assert transform.header.frame_id == graph.BODY_CAMERA_FRAME
    assert transform.header.stamp == bench.image(shown, encoding).header.stamp
    t = transform.transform.translation
    assert (t.x, t.y, t.z) == pytest.approx((0.1, -0.05, 0.9), abs=0.003)
    (entry,) = json.loads(bench.host.until(lambda: bench.last(graph.TAG_DETECTIONS)).data)
    assert entry["id"] == TAG_ID and entry["dist"] == pytest.approx(0.9, abs=0.003)
    stamp = transform.header.stamp
    assert entry["stamp"] == pytest.approx(stamp.sec + stamp.nanosec / 1e9, abs=1e-6)
    assert np.abs(np.array(entry["corners"]) - view.corners).max() < 0.2


def test_tag_transform_z_axis_points_out_of_the_marker(bench: Any, annotator: TagAnnotator, tag_views: ModuleType) -> None:
    from lupin_runtime.ros.tf import from_message
    from lupin_runtime.transforms import rotate

    bench.send_info(tag_views.CAMERA)
    bench.host.until(lambda: annotator._info is not None)
    view = facing_view(tag_views)
    bench.camera.publish(bench.image(view.image))
    transform = from_message(bench.host.until(bench.tag_transform))
    assert np.allclose(rotate(transform.rotation, (0.0, 0.0, 1.0)), view.rotation[:, 2], atol=0.03)
    assert np.allclose(rotate(transform.rotation, (1.0, 0.0, 0.0)), view.rotation[:, 0], atol=0.03)


def test_image_without_tags_gives_an_empty_array(bench: Any, annotator: TagAnnotator) -> None:
    bench.send_info()
    bench.host.until(lambda: annotator._info is not None)
    bench.camera.publish(bench.image(np.full((480, 640), 120, np.uint8)))
    assert json.loads(bench.host.until(lambda: bench.last(graph.TAG_DETECTIONS)).data) == []
    assert bench.tag_transform() is None


def test_empty_calibration_uses_the_assumed_camera(bench: Any, annotator: TagAnnotator, tag_views: ModuleType) -> None:
    bench.send_info()
    bench.host.until(lambda: annotator._info is not None)
    bench.camera.publish(bench.image(facing_view(tag_views).image))
    assert bench.host.until(bench.tag_transform).transform.translation.z == pytest.approx(0.9, abs=0.01)


def test_unreadable_image_is_dropped_and_the_next_one_used(bench: Any, annotator: TagAnnotator, tag_views: ModuleType) -> None:
    bench.send_info(tag_views.CAMERA)
    bench.host.until(lambda: annotator._info is not None)
    image = facing_view(tag_views).image
    broken = bench.image(image, "bayer_rggb8")
    short = bench.image(image)
    short.data = short.data[:1000]
    empty = bench.image(image)
    empty.height = empty.width = 0
    for message in (broken, short, empty):
        bench.camera.publish(message)
    # Only the newest image is kept, so the good one is sent until it was processed.
    bench.host.until(lambda: bench.camera.publish(bench.image(image)) or bench.tag_transform())


def test_padded_image_rows_are_read(bench: Any, annotator: TagAnnotator, tag_views: ModuleType) -> None:
    bench.send_info(tag_views.CAMERA)
    bench.host.until(lambda: annotator._info is not None)
    padded = np.pad(facing_view(tag_views).image, ((0, 0), (0, 64)))
    message = bench.image(padded)
    message.width, message.step = 640, 704
    bench.camera.publish(message)
    assert bench.host.until(bench.tag_transform).transform.translation.z == pytest.approx(0.9, abs=0.003)


# -- the aggregator ----------------------------------------------------------------------------------------------------


def test_three_sightings_discover_and_confirm_a_tag(bench: Any, aggregator: PerceptionAggregator) -> None:
    bench.odom_from_base = (1.0, 2.0, math.pi / 2)
    for count in range(1, 4):
        answer = bench.call_confirm("7")
        assert not answer.detected and answer.tag_pose_in_map.orientation.w == 0.0
        assert ("not discovered" if count == 1 else "below threshold") in answer.error_message
        bench.send_tag(7, (1.0, 0.0, 0.15))
        bench.host.until(lambda n=count: aggregator._registry.sightings("7") >= n, what=f"sighting {count}")
    tag = bench.discovered(7, sightings=3)
    p = tag.pose_in_map.position
    assert (p.x, p.y, p.z) == pytest.approx((1.0, 3.0, 0.15), abs=1e-6)
    answer = bench.call_confirm("7")
    assert answer.detected and answer.detection_confidence == 1.0 and answer.error_message == ""
    assert answer.tag_pose_in_map == tag.pose_in_map
    q = tag.pose_in_map.orientation
    nx, ny = 2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x)
    assert (nx, ny) == pytest.approx((0.0, -1.0), abs=1e-6)  # toward the robot


@pytest.mark.usefixtures("aggregator")
def test_confirmation_goes_stale(bench: Any) -> None:
    bench.time_ns -= int(20e9)
    for _ in range(3):
        bench.send_tag(7, (1.0, 0.0, 0.15))
    bench.discovered(7, 3)
    answer = bench.call_confirm("7")
    assert not answer.detected and "stale" in answer.error_message


def test_discovered_tag_and_its_box_are_drawn(bench: Any, aggregator: PerceptionAggregator) -> None:
    drawn: dict[str, Any] = {}
    for row in (graph.TAG_MARKERS, graph.BOX_MARKERS):
        bench.node.subscription(row, lambda message, name=row.name: drawn.update({name: message.markers}))
    for count in range(1, 4):
        bench.send_tag(7, (1.0, 0.0, 0.15))
        bench.host.until(lambda n=count: aggregator._registry.sightings("7") >= n)
    bench.host.until(lambda: len(drawn) == 2, what="markers of both topics")
    _, plate, text = drawn[graph.TAG_MARKERS.name]
    assert (plate.header.frame_id, text.text) == (graph.MAP_FRAME, "7")
    assert plate.pose.position.x == pytest.approx(1.0, abs=1e-6)
    _, box = drawn[graph.BOX_MARKERS.name]
    assert box.pose.position.x == pytest.approx(1.2, abs=1e-6)  # half the depth behind the tag


def test_tags_beyond_the_limit_are_not_sighted(bench: Any, aggregator: PerceptionAggregator) -> None:
    for count in range(1, 5):
        bench.send_tag(8, (2.9, 0.0, 0.15))
        bench.send_tag(7, (1.0, 0.0, 0.15))
        bench.host.until(lambda n=count: aggregator._registry.sightings("7") >= n)
    assert aggregator._registry.sightings("8") == 0


def test_sighting_uses_the_robot_pose_at_its_stamp(bench: Any, aggregator: PerceptionAggregator) -> None:
    """Between two images the robot turned; the transform of the second image arrives after its detection."""
    from std_msgs.msg import String

    from lupin_runtime.ros.tf import to_message
    from lupin_runtime.transforms import Transform

    bench.send_robot()
    first_ns = bench.time_ns
    picture_ns = first_ns + STEP_NS
    look = Transform((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0))
    bench.tf.send(to_message(graph.BODY_CAMERA_FRAME, "tag_7", picture_ns, look))
    bench.tag_json.publish(String(data=json.dumps([{"id": 7, "corners": [], "dist": 1.0}])))
    bench.host.until(lambda: aggregator._tree.waiting.get("7") and aggregator._tree.waiting["7"].detections)
    assert aggregator._registry.sightings("7") == 0
    bench.send_robot(odom_from_base=(0.0, 0.0, math.pi), stamp_ns=first_ns + 2 * STEP_NS)
    bench.host.until(lambda: aggregator._registry.sightings("7") == 1)
    pose = present(aggregator._registry.get("7")).pose
    # Halfway through the turn: the camera, 0.15 m in front of the base's center, faced along y.
    assert pose.translation[:2] == pytest.approx((0.0, 1.15), abs=1e-6)


def test_detection_without_transforms_is_dropped_and_logged(bench: Any, aggregator: PerceptionAggregator) -> None:
    from std_msgs.msg import String

    bench.tag_json.publish(String(data=json.dumps([{"id": 7, "corners": [], "dist": 1.0}])))
    bench.host.until(lambda: "7" in aggregator._seen_ids)
    bench.host.until(lambda: not aggregator._tree.waiting["7"].detections, what="the detection to be dropped")
    assert aggregator._registry.sightings("7") == 0


def test_malformed_messages_change_nothing(bench: Any, aggregator: PerceptionAggregator) -> None:
    from std_msgs.msg import String

    for text in ("", "{", '{"id": 1}', "[[1]]", '[{"id": 7, "dist": "far"}]', '[{"id": 7, "dist": NaN}]', "\x00"):
        bench.tag_json.publish(String(data=text))
        bench.flower_json.publish(String(data=text))
        bench.boxes.publish(String(data=text))
    for _ in range(3):
        bench.send_tag(9, (1.0, 0.0, 0.15))
    bench.discovered(9, 3)
    assert aggregator._registry.sightings("7") == 0


def test_known_tags_follow_a_jump_of_the_map(bench: Any, aggregator: PerceptionAggregator) -> None:
    for k in range(60):
        bench.odom_from_base = (0.1 * k, 0.0, 0.0)
        bench.time_ns += STEP_NS
        bench.send_robot(bench.map_from_odom, bench.odom_from_base)
        if k == 0:
            bench.host.until(lambda: aggregator._motion._path, what="the start of the path")
    bench.host.until(lambda: aggregator._motion.traveled > 5.8, what="the whole path")
    for _ in range(3):
        bench.send_tag(7, (1.0, 0.0, 0.15))
    before = bench.discovered(7, 3).pose_in_map.position.x
    steps = aggregator._motion._steps
    bench.host.until(lambda: sum(step[1] for step in list(steps)) < 0.01, what="the robot to have stood for a moment")
    bench.map_from_odom = (0.4, 0.0, 0.0)
    bench.time_ns += STEP_NS
    bench.send_robot(bench.map_from_odom, bench.odom_from_base)
    moved = bench.host.until(lambda: bench.discovered(7, 3).pose_in_map.position.x - before > 0.3, what="the tag to move along")
    assert moved
    assert bench.discovered(7).pose_in_map.position.x - before == pytest.approx(0.4, abs=0.02)


def test_lost_robot_records_no_tag_and_moves_none(bench: Any, aggregator: PerceptionAggregator) -> None:
    from geometry_msgs.msg import PoseWithCovarianceStamped

    poses = bench.node.publisher(graph.AMCL_POSE)
    bench.wait_for_subscriptions(poses)

    def send_pose(variance: float) -> None:
        message = PoseWithCovarianceStamped()
        for index in PLANAR_VARIANCES:
            message.pose.covariance[index] = variance
        poses.publish(message)

    def see(tag_id: int, times: int) -> None:
        for _ in range(times):
            bench.send_tag(tag_id, (1.0, 0.0, 0.15))
        bench.host.until(lambda: str(tag_id) in aggregator._seen_ids, what=f"tag {tag_id} in view")

    send_pose(0.01)
    see(7, 5)
    before = bench.discovered(7, 5).pose_in_map.position.x
    send_pose(LOST_YAW_VARIANCE)
    bench.host.until(lambda: aggregator._lost, what="the lost robot")
    bench.map_from_odom = (0.6, 0.4, 0.0)  # a transform that is sent nevertheless
    see(8, 3)
    assert aggregator._registry.sightings("8") == 0
    send_pose(0.01)
    bench.host.until(lambda: not aggregator._lost, what="the found robot")
    see(9, 5)
    assert bench.discovered(9, 3).pose_in_map.position.x == pytest.approx(1.6, abs=0.02)
    assert [tag.tag_id for tag in bench.last(graph.DISCOVERED_TAGS).tags] == ["7", "9"]
    assert bench.discovered(7, 5).pose_in_map.position.x == pytest.approx(before, abs=0.001)


def test_clock_going_back_keeps_tags_and_accepts_new_sightings(bench: Any, aggregator: PerceptionAggregator) -> None:
    for _ in range(3):
        bench.send_tag(7, (1.0, 0.0, 0.15))
    bench.discovered(7, 3)
    back_ns = 3600 * 10**9
    now = aggregator.now_ns
    aggregator.now_ns = lambda: now() - back_ns  # type: ignore[method-assign]
    bench.host.until(lambda: aggregator._newest_ns < now() - back_ns // 2, what="the step to be noticed")
    assert "stale" in bench.call_confirm("7").error_message
    bench.time_ns -= back_ns
    bench.host.until(
        lambda: bench.send_tag(7, (1.0, 0.0, 0.15)) or aggregator._registry.sightings("7") > 3, what="a sighting after the step"
    )
    assert bench.call_confirm("7").detected


def mission(state: str = "MONITORING", phase: str = "SCANNING", target: str = "7") -> MissionState:
    from lupin_msgs.msg import MissionState

    return MissionState(lifecycle_state=state, mission_phase=phase, current_target=target, mission_id="lupin-1")


def flower_detections(*entries: Any) -> String:
    from std_msgs.msg import String

    return String(
        data=json.dumps([{"class": c, "confidence": p, "bbox_xyxy": [x - 20, 200, x + 20, 260]} for c, p, x in entries])
    )


def flower_observations(bench: Any) -> list[Observation]:
    return [m for m in bench.received[graph.OBSERVATIONS.name] if m.kind == m.KIND_FLOWER]


def test_flowers_of_the_pot_in_focus_are_published(bench: Any, aggregator: PerceptionAggregator) -> None:
    for _ in range(3):
        bench.send_tag(7, (1.0, 0.0, 0.15))
    bench.discovered(7, 3)
    bench.mission.publish(mission())
    bench.host.until(lambda: aggregator._mission is not None and aggregator._accumulator.target == "7")
    bench.flower_json.publish(flower_detections((0, 0.9, 320), (0, 0.8, 520), (3, 0.7, 520)))
    message = bench.host.until(lambda: flower_observations(bench))[-1]
    flower = message.flower
    assert (message.source, message.mission_id, message.header.frame_id) == ("perception_aggregator", "lupin-1", "map")
    assert message.status == message.STATUS_OK
    assert (flower.tag_id, flower.species, flower.anomaly) == ("7", "tulip_red", True)
    assert flower.confidence == pytest.approx(0.9)
    assert (flower.flower_count, flower.bug_count) == (2, 1)
    assert [f.species for f in flower.flowers] == ["tulip_red", "tulip_red"]
    assert flower.flowers[0].position.x == pytest.approx(1.0 + 0.4 * (0.5 + (3 * 0.6180339887498949 % 1 - 0.5) * 0.36))
    assert flower.flowers[0].height_m == pytest.approx(0.35)
    assert len(flower.box_footprint.points) == 4
    assert message.tag_pose_in_map.position.x == pytest.approx(1.0, abs=1e-6)
    tag = bench.discovered(7)
    bench.host.until(lambda: bench.discovered(7).species == "tulip_red")
    assert tag.tag_id == "7"


def test_unchanged_flowers_are_published_once(bench: Any, aggregator: PerceptionAggregator) -> None:
    bench.mission.publish(mission())
    bench.host.until(lambda: aggregator._mission is not None and aggregator._accumulator.target == "7")
    for _ in range(5):
        bench.flower_json.publish(flower_detections((0, 0.9, 320)))
    bench.flower_json.publish(flower_detections((0, 0.95, 320), (2, 0.5, 600)))
    bench.host.until(lambda: any(m.flower.flower_count == 2 for m in flower_observations(bench)))
    assert [m.flower.flower_count for m in flower_observations(bench)] == [1, 2]


def test_driving_mission_leaves_nothing_in_focus(bench: Any, aggregator: PerceptionAggregator) -> None:
    bench.mission.publish(mission(phase="NAVIGATING"))
    bench.host.until(lambda: aggregator._mission is not None)
    bench.flower_json.publish(flower_detections((0, 0.9, 320)))
    bench.mission.publish(mission(target="8"))
    bench.host.until(lambda: aggregator._accumulator.target == "8")
    bench.flower_json.publish(flower_detections((1, 0.9, 320)))
    (message,) = bench.host.until(lambda: flower_observations(bench))
    assert (message.flower.tag_id, message.flower.species) == ("8", "tulip_white")


def test_nearest_tag_is_in_focus_without_a_mission(bench: Any, aggregator: PerceptionAggregator) -> None:
    from std_msgs.msg import String

    entries = [{"id": 5, "corners": [], "dist": 1.4}, {"id": 6, "corners": [], "dist": 0.9}]
    bench.tag_json.publish(String(data=json.dumps(entries)))
    bench.host.until(lambda: aggregator._last_frame)
    bench.flower_json.publish(flower_detections((2, 0.9, 320)))
    (message,) = bench.host.until(lambda: flower_observations(bench))
    assert message.flower.tag_id == "6"
    # The tag's pose is unknown: the message says so, and one flower is placed at the anchor.
    assert message.tag_pose_in_map.orientation.w == 0.0 and len(message.flower.flowers) == 1


def test_registered_box_places_flowers_and_drops_those_beside_it(bench: Any, aggregator: PerceptionAggregator) -> None:
    from std_msgs.msg import String

    box = {"id": "7", "x": 3.0, "y": 1.0, "yaw": math.pi, "width": 0.3, "depth": 0.3, "height": 0.5}
    bench.boxes.publish(String(data=json.dumps({"boxes": [box]})))
    bench.host.until(lambda: aggregator._boxes)
    bench.mission.publish(mission())
    bench.host.until(lambda: aggregator._mission is not None and aggregator._accumulator.target == "7")
    bench.flower_json.publish(flower_detections((0, 0.9, 320)))
    flower = bench.host.until(lambda: flower_observations(bench))[-1].flower
    p = flower.pose.pose.position
    assert (p.x, p.y, p.z) == pytest.approx((3.0, 1.0, 0.5))
    assert flower.flowers[0].height_m == pytest.approx(0.5)
    assert aggregator._options.gate


# -- flower detectors --------------------------------------------------------------------------------------------------


def garden() -> np.ndarray:
    image = np.full((480, 640, 3), (60, 140, 60), np.uint8)
    red = cv2.cvtColor(np.array([[(175, 220, 200)]], np.uint8), cv2.COLOR_HSV2BGR)[0, 0]
    cv2.ellipse(image, (300, 200), (24, 32), 0, 0, 360, tuple(int(v) for v in red), -1)
    return image


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8"])
def test_simulated_detector_draws_only_for_subscribers(bench: Any, graph_host: GraphHost, encoding: str) -> None:
    from lupin_runtime.perception.node import SimFlowerDetector

    detector = graph_host.add(SimFlowerDetector())
    bench.wait_for_subscriptions(bench.gripper)
    graph_host.until(lambda: detector._overlay.get_subscription_count() > 0)
    image = garden() if encoding == "bgr8" else garden()[..., ::-1]
    bench.gripper.publish(bench.image(image, encoding, frame=graph.GRIPPER_CAMERA_FRAME))
    (entry,) = json.loads(graph_host.until(lambda: bench.last(graph.FLOWER_DETECTIONS)).data)
    assert (entry["class"], entry["class_name"]) == (0, "tulip_red")
    assert entry["confidence"] == 1.0 and np.abs(np.array(entry["bbox_xyxy"]) - (276, 168, 324, 232)).max() < 4
    overlay = graph_host.until(lambda: bench.last(graph.FLOWER_OVERLAY))
    assert (overlay.width, overlay.height, overlay.encoding) == (640, 480, "bgr8")
    assert not np.array_equal(np.frombuffer(overlay.data, np.uint8).reshape(480, 640, 3), garden())


def test_image_without_flowers_publishes_nothing(bench: Any, graph_host: GraphHost) -> None:
    from lupin_runtime.perception.node import SimFlowerDetector

    graph_host.add(SimFlowerDetector({"publish_overlay": False}))
    bench.wait_for_subscriptions(bench.gripper)
    bench.gripper.publish(bench.image(np.full((480, 640, 3), (60, 140, 60), np.uint8), "bgr8"))
    graph_host.until(lambda: bench.gripper.publish(bench.image(garden(), "bgr8")) or bench.last(graph.FLOWER_DETECTIONS))
    assert all(json.loads(m.data) for m in bench.received[graph.FLOWER_DETECTIONS.name])


@pytest.mark.usefixtures("graph_host")
def test_trained_detector_without_its_library_refuses_to_start() -> None:
    from lupin_runtime.perception.flower_nodes import DetectorUnavailable
    from lupin_runtime.perception.node import YoloDetector

    with pytest.raises(DetectorUnavailable, match=r"needs the package ultralytics.*pip install"):
        YoloDetector()


def test_trained_detector_without_its_weights_refuses_to_start(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import sys
    from types import ModuleType

    from lupin_runtime.perception.flower_nodes import DetectorUnavailable, load_model

    library = ModuleType("ultralytics")
    vars(library)["YOLO"] = lambda path: ("model", path)
    monkeypatch.setitem(sys.modules, "ultralytics", library)
    with pytest.raises(DetectorUnavailable, match=r"model_path is 'best\.pt', which is not a file"):
        load_model("best.pt")
    weights = tmp_path / "best.pt"
    weights.touch()
    assert load_model(str(weights)) == ("model", str(weights))


def test_trained_boxes_become_detections_with_tracks() -> None:
    from types import SimpleNamespace

    from lupin_runtime.perception.flower_nodes import detections_from_boxes

    boxes = SimpleNamespace(
        cls=np.array([0.0, 3.0]),
        conf=np.array([0.9, 0.4]),
        xyxy=np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]]),
        id=np.array([11.0, 12.0]),
    )
    red, bug = detections_from_boxes(boxes)
    assert (red.class_id, red.track_id, bug.class_id, bug.box_px) == (0, 11, 3, (5.0, 6.0, 7.0, 8.0))
    boxes.id = None
    assert [b.track_id for b in detections_from_boxes(boxes)] == [None, None]
