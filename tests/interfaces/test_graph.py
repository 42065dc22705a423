"""Messages, services and actions work between two processes, and their type hashes equal those of the upstream packages."""

from __future__ import annotations

import importlib
import math
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install ./interfaces")

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Point32, Pose, PoseStamped, Quaternion
from lupin_msgs.msg import FlowerObservation, FlowerPoint, Observation, SensorReading
from lupin_msgs.srv import GetField
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float32

from tests.support.waiting import WAIT_S, wait_until

pytestmark = pytest.mark.graph

LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)

UPSTREAM_HASHES = {
    "nav2_msgs.msg.Costmap": "d51bf7aecafdbb3f8f98215de648abe6d53f8db69156d6e143125d2ad2bf0027",
    "nav2_msgs.msg.CostmapUpdate": "b44706e1f0906a3f72a1640bc2153e85576ff8e8ad203ec48b78c187669168a2",
    "nav2_msgs.msg.ParticleCloud": "193d8cb88ca2b98cd81ece15342744f054bb398ebfa8f6369914432303f42b11",
    "nav2_msgs.msg.CollisionMonitorState": "848f43f40716d6b3ac12a698cc3974a7eb2bf00158c5fca7bb93a128850d5a1e",
    "nav2_msgs.action.NavigateToPose.Goal": "22a9dffbd6733011220460bd52edbc7843c8fc86282d40bc7ad3ca176a9dec10",
    "nav2_msgs.action.NavigateToPose.Result": "ddbff7fc6d1e51d774d5defdb8398a57cb23fa8709355002d676408bb4860b85",
    "nav2_msgs.action.NavigateToPose.Feedback": "9ebc544c7d41bd8c6060b191bf9f5e4ddca6c2f61ee9e04fcb62ed5d67218a33",
    "nav2_msgs.action.ComputePathToPose.Goal": "9b2a136db06950716ad4a46b9d01bb628703cad155650c0b8233fb6a2f2783fa",
    "nav2_msgs.action.AssistedTeleop.Result": "94dc3582c30005fa65d2b5558c5046b2b5da199c07025af0fab2ddd3da46757c",
    "slam_toolbox.srv.ToggleInteractive.Request": "7b39d752f49ba967d72bcc6e340de08073a8577a13f107ca0aea076e664cb911",
    "slam_toolbox.srv.DeserializePoseGraph.Request": "1bde65c133a93f94c09966a0206ce03946703695bc84e25aebf92fe61a0ae4b0",
}
"""The RIHS01 hashes of types of Nav2 and slam_toolbox, which colcon built from their sources."""


def observation() -> Observation:
    """Return a message with nested, repeated, empty and non-ASCII fields."""
    message = Observation(mission_id="lupin-0123abcd", source="InspectionMission", kind=Observation.KIND_FLOWER)
    message.header.frame_id = "map"
    message.header.stamp.sec = 1_700_000_000
    message.status_detail = "žluť – 黄"
    message.tag_reading.readings = [SensorReading(name="co2", value=412.5), SensorReading(name="light", value=-0.0)]
    bloom = FlowerPoint(position=Point(x=1.0, y=-2.0, z=0.4), height_m=0.25, species="tulip_red", confidence=0.5)
    message.flower = FlowerObservation(tag_id="7", flower_count=65535, flowers=[bloom, FlowerPoint(anomaly=True)])
    message.flower.box_footprint.points = [Point32(x=float(corner)) for corner in range(4)]
    message.tag_pose_in_map = Pose(position=Point(x=3.5), orientation=Quaternion(w=1.0))
    return message


def receive(node_and_executor: Any, message_type: type, topic: str, **options: Any) -> Any:
    """Wait for the first message on a latched topic, and return it."""
    node, executor = node_and_executor
    received: list[Any] = []
    node.create_subscription(message_type, topic, received.append, LATCHED, **options)
    wait_until(lambda: received, f"a message on {topic}", interval_s=0.0, each=lambda: executor.spin_once(timeout_sec=0.1))
    return received[0]


def result_of(node_and_executor: Any, future: Any) -> Any:
    """Spin until a future is done, and return its result."""
    _, executor = node_and_executor
    executor.spin_until_future_complete(future, timeout_sec=WAIT_S)
    assert future.done(), f"no response within {WAIT_S} s"
    return future.result()


def test_message_is_echoed_unchanged(node_and_executor: Any, start_peer: Any) -> None:
    start_peer("echo")
    node_and_executor[0].create_publisher(Observation, "observations", LATCHED).publish(observation())
    assert receive(node_and_executor, Observation, "echoed") == observation()


def test_forwarded_raw_bytes_are_unchanged(node_and_executor: Any, start_peer: Any) -> None:
    start_peer("forward")
    node_and_executor[0].create_publisher(Observation, "observations", LATCHED).publish(serialize_message(observation()))
    forwarded = receive(node_and_executor, Observation, "forwarded", raw=True)
    assert forwarded == serialize_message(observation())
    assert deserialize_message(forwarded, Observation) == observation()


def test_service_of_another_process_responds(node_and_executor: Any, start_peer: Any) -> None:
    start_peer("serve")
    client = node_and_executor[0].create_client(GetField, "get_field")
    assert client.wait_for_service(WAIT_S)
    request = GetField.Request(sensor_type="humidity", resolution=0.5, bbox_min_x=-1.0, bbox_max_x=2.0)
    response = result_of(node_and_executor, client.call_async(request))
    assert (response.ok, response.width, response.error_message, response.resolution_used) == (True, 3, "humidity", 0.5)
    assert response.values[0] == -1.0 and math.isnan(response.values[1]) and response.values[2] == 2.0


def test_action_of_another_process_sends_feedback_and_result(node_and_executor: Any, start_peer: Any) -> None:
    start_peer("act")
    client = ActionClient(node_and_executor[0], NavigateToPose, "navigate_to_pose")
    assert client.wait_for_server(WAIT_S)
    feedback: list[Any] = []
    receipts = node_and_executor[0].create_publisher(Float32, "feedback_received", LATCHED)

    def on_feedback(message: Any) -> None:
        feedback.append(message.feedback)
        receipts.publish(Float32(data=message.feedback.distance_remaining))

    goal = NavigateToPose.Goal(pose=PoseStamped(pose=Pose(position=Point(x=7.0))), behavior_tree="tree.xml")
    goal_handle = result_of(node_and_executor, client.send_goal_async(goal, feedback_callback=on_feedback))
    assert goal_handle.accepted
    response = result_of(node_and_executor, goal_handle.get_result_async())
    assert (response.status, response.result.error_msg) == (GoalStatus.STATUS_SUCCEEDED, "tree.xml")
    assert list(dict.fromkeys(f.distance_remaining for f in feedback)) == [2.0, 1.0]  # each at least once
    assert feedback[0].current_pose.pose.position.x == 7.0
    client.destroy()


@pytest.mark.parametrize("dotted", UPSTREAM_HASHES)
def test_type_hash_equals_upstream_hash(node_and_executor: Any, dotted: str) -> None:
    package, kind, name, *nested = dotted.split(".")
    message_type = getattr(importlib.import_module(f"{package}.{kind}"), name)
    message_type = getattr(message_type, nested[0]) if nested else message_type
    assert type_hash(node_and_executor[0], message_type) == UPSTREAM_HASHES[dotted]


def test_lupin_messages_have_different_type_hashes(node_and_executor: Any) -> None:
    module = importlib.import_module("lupin_msgs.msg")
    names = [name for name in vars(module) if name[0].isupper()]
    hashes = {name: type_hash(node_and_executor[0], getattr(module, name)) for name in names}
    assert len(set(hashes.values())) == len(names)


def type_hash(node: Any, message_type: type) -> str:
    """Return the RIHS01 hash of a type, in hex, as the graph reports it for a topic."""
    publisher = node.create_publisher(message_type, f"hash_of/{message_type.__name__}", 1)
    try:
        (endpoint,) = node.get_publishers_info_by_topic(publisher.topic_name)
        assert endpoint.topic_type_hash.version == 1
        return bytes(endpoint.topic_type_hash.value).hex()
    finally:
        node.destroy_publisher(publisher)
