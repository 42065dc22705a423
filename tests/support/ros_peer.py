"""The other process in tests of the interfaces: it echoes, forwards, serves or acts until SIGTERM.

It also runs on Python 3.10, and needs only rclpy and the interfaces.
"""

from __future__ import annotations

import signal
import sys

import rclpy
from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


def echo(node: Node) -> None:
    """Publish every Observation again, deserialized and serialized by Python."""
    from lupin_msgs.msg import Observation

    publisher = node.create_publisher(Observation, "echoed", LATCHED)
    node.create_subscription(Observation, "observations", publisher.publish, LATCHED)


def forward(node: Node) -> None:
    """Publish every Observation again, as the received bytes."""
    from lupin_msgs.msg import Observation

    publisher = node.create_publisher(Observation, "forwarded", LATCHED)
    node.create_subscription(Observation, "observations", publisher.publish, LATCHED, raw=True)


def serve(node: Node) -> None:
    """Answer GetField with a row of three values, the second of which is NaN."""
    from lupin_msgs.srv import GetField

    def answer(request: GetField.Request, response: GetField.Response) -> GetField.Response:
        response.ok = True
        response.values = [request.bbox_min_x, float("nan"), request.bbox_max_x]
        response.width, response.height = 3, 1
        response.resolution_used = request.resolution
        response.error_message = request.sensor_type
        return response

    node.create_service(GetField, "get_field", answer)


def act(node: Node) -> None:
    """Let every NavigateToPose goal succeed, after two feedback messages whose receipt the client has confirmed.

    rclpy's client drops feedback that it receives after the goal's last status.
    """
    from nav2_msgs.action import NavigateToPose
    from std_msgs.msg import Float32

    confirmed = {2.0: Future(), 1.0: Future()}
    node.create_subscription(Float32, "feedback_received", lambda message: confirmed[message.data].set_result(None), LATCHED)

    async def navigate(goal_handle: ServerGoalHandle) -> NavigateToPose.Result:
        for distance, confirmation in confirmed.items():
            feedback = NavigateToPose.Feedback(distance_remaining=distance, current_pose=goal_handle.request.pose)
            # The client may not be discovered yet, although it has discovered this server.
            repeating = node.create_timer(0.1, lambda feedback=feedback: goal_handle.publish_feedback(feedback))
            await confirmation
            node.destroy_timer(repeating)
        goal_handle.succeed()
        return NavigateToPose.Result(error_code=NavigateToPose.Result.NONE, error_msg=goal_handle.request.behavior_tree)

    node.action_server = ActionServer(node, NavigateToPose, "navigate_to_pose", navigate)


def main() -> None:
    """Take the role in the first argument, print `ready`, and run until SIGTERM."""
    stopping: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stopping.append(number))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("interfaces_peer", start_parameter_services=False, enable_rosout=False)
    {"echo": echo, "forward": forward, "serve": serve, "act": act}[sys.argv[1]](node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print("ready", flush=True)
    while not stopping:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()  # before rclpy, or the process aborts
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
