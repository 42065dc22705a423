"""A plain rclpy node with the inputs of the robot's own part of the stack, and what that repeats at rest.

It is a program of its own, with one node and one executor, as in rclpy's tutorials. It decides nothing, moves nothing, and
publishes on topics of its own.
"""

from __future__ import annotations

import rclpy
from geometry_msgs.msg import Twist
from mirte_msgs.msg import IntensityDigital
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool


class PlainNode(Node):
    """Receives the button and the joint states, repeats a state at 5 Hz and a zero at 2 Hz, and has a tick of 20 Hz."""

    def __init__(self) -> None:
        super().__init__("lupin_bench_peer")
        self._state = self.create_publisher(Bool, "/lupin_bench_peer/state", 10)
        self._velocity = self.create_publisher(Twist, "/lupin_bench_peer/velocity", 1)
        self._joints: JointState | None = None
        self._pressed = False
        self.create_subscription(JointState, "/joint_states", self._on_joints, 10)
        self.create_subscription(IntensityDigital, "/io/intensity/emergency_button/digital", self._on_button, 10)
        self.create_timer(0.2, lambda: self._state.publish(Bool(data=self._pressed)))
        self.create_timer(0.05, lambda: None)
        self.create_timer(0.5, lambda: self._velocity.publish(Twist()))

    def _on_joints(self, message: JointState) -> None:
        self._joints = message

    def _on_button(self, message: IntensityDigital) -> None:
        self._pressed = bool(message.value)


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(PlainNode())
