"""The layer between cores and rclpy: a node class that reads `graph.py`, transforms, clocks, and the runner of nodes.

It works with Jazzy's rclpy from Python wheels and with Humble's on Python 3.10, which the robot has.
"""

from lupin_runtime.ros.node import LupinNode
from lupin_runtime.ros.node_runner import run
from lupin_runtime.ros.stamps import stamp_from_ns, stamp_ns
from lupin_runtime.ros.tf import TransformBroadcaster, TransformListener

__all__ = ["LupinNode", "TransformBroadcaster", "TransformListener", "run", "stamp_from_ns", "stamp_ns"]
